// Accessors out of a GLB's BIN chunk: every count, offset and length is checked before anything is reserved for it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "GlbContainer.h"
#include "Terraport/Json.h"
#include "Terraport/SegmentBuffer.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// glTF's component types, as far as payloads use them.
enum class GltfComponent : std::uint32_t { Byte = 5120, UnsignedShort = 5123, UnsignedInt = 5125, Float = 5126 };

/// Layout that an accessor must have.
struct GltfExpectation {
  /// For error texts; also says which filters are allowed.
  std::string_view label;
  GltfComponent component = GltfComponent::UnsignedShort;
  /// Another component type that will do; the same where there is none.
  GltfComponent alternative = GltfComponent::UnsignedShort;
  /// glTF's word, and its number of components.
  std::string_view type;
  std::size_t width = 1;
};

/// An accessor whose numbers were looked at: its bytes are there, and not decoded yet.
struct GltfRows {
  std::size_t count = 0;
  GltfComponent component = GltfComponent::UnsignedShort;
  /// Bytes from one row to the next, as they are stored.
  std::size_t stride = 0;
  /// The accessor states that its integers are fractions.
  bool isNormalised = false;
  bool isCompressed = false;
  bool isOctahedral = false;
  bool isExponential = false;
  bool isTriangles = false;
  /// Compressed, or as they are.
  ByteSpan bytes;
  /// Where `bytes` lie in the payload.
  std::size_t offset = 0;
  std::string_view label;
};

/// Reads what a GLB's document points to.
class GltfReader {
 public:
  /// `document` is the parsed JSON chunk; chunks and document must outlive the reader.
  Status begin(const GlbChunks& chunks, JsonValue document, std::size_t payloadBytes);

  /// Check a vertex attribute; its bytes are located, and not decoded yet. Damaged where it is not as expected.
  Status findVertices(JsonValue number, const GltfExpectation& expected, GltfRows& rows);
  /// The same for the vertex numbers, three a face.
  Status findIndices(JsonValue number, GltfRows& rows);
  /// The bytes of an image file, and where they lie in the payload.
  Status findImage(JsonValue number, ByteSpan& bytes, std::size_t& offset) const;

  /// Decode rows of an attribute: rows.count * rows.stride bytes.
  static Status decode(const GltfRows& rows, std::uint8_t* out);
  /// Decode vertex numbers: rows.count of them.
  static Status decodeIndices(const GltfRows& rows, std::uint32_t* out);

 private:
  Status find(JsonValue number, const GltfExpectation& expected, GltfRows& rows, JsonValue& view) const;
  Status locate(JsonValue view, GltfRows& rows);
  Status locatePacked(JsonValue packed, GltfRows& rows);
  Status slice(JsonValue range, std::uint64_t length, std::string_view label, ByteSpan& bytes, std::size_t& offset) const;
  Status readFilter(JsonValue packed, GltfRows& rows) const;

  GlbChunks chunks_;
  JsonValue accessors_;
  JsonValue views_;
  /// Bytes that may still be decoded: views that are named again and again must not make much out of little.
  std::uint64_t leftBytes_ = 0;
};

}  // namespace terraport
