// Segments in format 2 (spec/segment-format.md): the payload of a segment, and the base mesh.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "Core/Basics.h"

struct z_stream_s;

namespace terraport {

/// How an attribute's codes become values, from the scene's manifest.
struct AttributeScale {
  std::string name;
  double offset = 0.0;
  double step = 1.0;
};

enum class ImageKind : std::uint8_t { None, Jpeg, Png, Webp, Ktx2 };

/// "image/jpeg" and so on; empty for None.
const char* mediaTypeOf(ImageKind kind);

/// An image file behind a segment's planes, not decoded. Kind and sides were read from the file.
struct SegmentImage {
  ImageKind kind = ImageKind::None;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  /// What a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32.
  std::uint32_t texelBits = 32;
  /// Where the file is in the payload.
  std::size_t offset = 0;
  std::size_t bytes = 0;

  ByteSpan fileOf(ByteSpan payload) const { return {payload.data + offset, bytes}; }
  /// Bytes of the texture with all mips; 0 without an image.
  std::size_t gpuBytes() const;
};

/// A decoded segment. Decode the next one into the same object: its arrays keep their memory.
struct SegmentMesh {
  std::uint32_t vertexCount = 0;
  std::uint32_t faceCount = 0;
  /// Three for each vertex, metres.
  std::vector<float> positions;
  /// Three for each vertex; 127 is 1, and the length is not exactly 1.
  std::vector<std::int8_t> normals;
  /// Three sRGB levels for each vertex; empty without.
  std::vector<std::uint8_t> colours;
  /// Two for each vertex, (0, 0) is the image's upper left corner; empty without an image.
  std::vector<float> uvs;
  /// One for each vertex; empty where no vertex has a region.
  std::vector<std::uint16_t> regions;
  /// Three for each face, counter-clockwise seen from outside.
  std::vector<std::uint32_t> indices;
  /// By the scene's order; empty where the segment lacks it. 65535: no value.
  std::vector<std::vector<std::uint16_t>> attributes;
  SegmentImage image;
  Box bounds;

  /// Bytes of memory held.
  std::size_t capacityBytes() const;
};

/// Inflates whole gzip streams; holds zlib's memory from one to the next.
class Inflater {
 public:
  Inflater() = default;
  ~Inflater();
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  /// Whether the stream is one of exactly `size` bytes, and its checksum is right.
  bool inflateGzip(ByteSpan packed, std::size_t size, Bytes& out);

 private:
  /// zlib's, whose header stays out of this one; null before the first stream.
  z_stream_s* stream_ = nullptr;
};

/// Decodes segments. Safe on any bytes: planes take at most 2^28 bytes, and every length is compared with what is there.
/// Holds memory that is used again: one for each thread.
class SegmentDecoder {
 public:
  enum class Kind : std::uint8_t { Segment, Base };

  /// `attributes`: how many the scene has. After a failure the mesh is undefined.
  Status decode(ByteSpan payload, std::size_t attributes, Kind kind, SegmentMesh& mesh);

 private:
  Inflater inflater_;
  Bytes stream_;
  /// Vertices of the corners that are not new.
  std::vector<std::uint32_t> oldCorners_;

  friend class SegmentReading;
};

}  // namespace terraport
