// One decoded payload, or the base mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/SegmentBuffer.h"
#include "Terraport/Types.h"

namespace terraport {

/// How positions are stored.
enum class VertexForm : std::uint8_t {
  /// Whole numbers, as segments have them.
  Codes,
  /// float32, as an uncompressed GLB may have them.
  Floats,
};

enum class ImageType : std::uint8_t { None, Jpeg, Png, Webp, Ktx2 };

/// "image/jpeg" and so on; empty for None.
TERRAPORTCORE_API const char* mediaTypeOf(ImageType type);

/// The image file of a textured payload, not decoded. Its header was read: type and sides are those, powers of two, at most
/// 2048 (base: 4096).
struct PayloadImage {
  ImageType type = ImageType::None;
  /// Pixels.
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  /// What a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32 (whatever GPUs cannot read).
  std::uint32_t texelBits = 32;
  /// Where the file lies in the payload, bytes.
  std::size_t offset = 0;
  std::size_t bytes = 0;

  /// Bytes of its texture on a GPU with all mips (wire protocol, section 6.2); 0 where there is none.
  TERRAPORTCORE_API std::size_t gpuBytes() const;
};

/// One attribute of the survey, one value per vertex.
struct AttributeColumn {
  /// UTF-8, as the survey has it.
  std::string name;
  /// Value = offset + step * code; 65535 means "no value".
  double offset = 0.0;
  double step = 1.0;
  SegmentBuffer<std::uint16_t> codes;
};

/// Whatever an engine makes of a mesh on the decoding thread (DecodeThreads' hook) and keeps with it, so that its memory is
/// used again too.
class TERRAPORTCORE_API EngineData {
 public:
  virtual ~EngineData() = default;
};

/// A decoded payload in buffers that are used again: decode the next one into the same object and nothing is allocated, once
/// they are large enough. Not copyable; one thread at a time.
///
/// Every decoder has checked it: indices are below `vertexCount`, positions and normals finite, normals longer than 0, texture
/// coordinates from 0 to 1, all columns of equal length.
class TERRAPORTCORE_API SegmentMesh {
 public:
  /// -1 for the base mesh.
  std::int64_t segment = -1;
  std::uint32_t vertexCount = 0;
  std::uint32_t faceCount = 0;

  /// With Codes a vertex lies at float32(translation + stepM * code), metres; with Floats the translation is 0 and the step 1.
  VertexForm positionForm = VertexForm::Codes;
  double translation[3] = {0.0, 0.0, 0.0};
  double stepM = 1.0;
  /// Four entries per vertex, the fourth is padding.
  SegmentBuffer<std::uint16_t> positionCodes;
  /// Three entries per vertex, metres, scene frame.
  SegmentBuffer<float> positions;

  /// Four entries per vertex, the fourth is padding; 127 is 1; not exactly of length 1.
  SegmentBuffer<std::int8_t> normalCodes;

  bool hasColours = false;
  /// Four entries per vertex: sRGB and 255.
  SegmentBuffer<std::uint8_t> colours;

  /// Only where there is an image. (0, 0) is the image's upper left corner.
  bool hasUvs = false;
  /// A texture coordinate is uvScale * code.
  float uvScale[2] = {1.0F, 1.0F};
  /// The scale is 1 / 65535, which float32 does not have: divide the code by 65535.
  bool uvsNormalised = false;
  /// Two entries per vertex.
  SegmentBuffer<std::uint16_t> uvCodes;

  bool hasRegionIds = false;
  /// One entry per vertex.
  SegmentBuffer<std::uint16_t> regionIds;

  /// The first `attributeCount` of `attributes` count; the rest is memory of payloads before.
  std::size_t attributeCount = 0;
  std::vector<AttributeColumn> attributes;

  /// Three entries per face, counter-clockwise from outside.
  SegmentBuffer<std::uint32_t> indices;
  /// The largest of `indices`: below 65536 they may be handed on as 16-bit numbers.
  std::uint32_t maxIndex = 0;

  PayloadImage image;

  /// Box of the decoded positions.
  Box bounds;

  /// The engine's own; `clear` leaves it alone.
  std::unique_ptr<EngineData> engineData;

  /// Forget what was decoded; memory is kept.
  void clear();

  /// Bytes of memory held.
  std::size_t capacityBytes() const;

  /// Positions, metres of the scene frame: `out` takes 3 * vertexCount.
  void writePositions(float* out) const;
  /// Unit normals: `out` takes 3 * vertexCount.
  void writeNormals(float* out) const;
  /// Texture coordinates: `out` takes 2 * vertexCount. Only where `hasUvs`.
  void writeUvs(float* out) const;
  /// Values of an attribute, NaN for none: `out` takes vertexCount. `column` is below `attributeCount`.
  void writeAttribute(std::size_t column, float* out) const;
};

/// sRGB level (IEC 61966-2-1) nearest to a 16-bit linear code: exact for what was encoded.
TERRAPORTCORE_API std::uint8_t srgbOfLinear16(std::uint16_t code);

}  // namespace terraport
