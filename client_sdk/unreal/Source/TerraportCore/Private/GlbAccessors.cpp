#include "GlbAccessors.h"

#include <cstring>
#include <string>

#include "JsonExpect.h"
#include "LittleEndian.h"
#include "Meshopt.h"

namespace terraport {
namespace {

constexpr std::string_view kMeshopt = "EXT_meshopt_compression";
/// Vertex codec 0 spends at least 4 bytes a channel per block of up to 256 rows; the index codec a byte a triangle.
constexpr std::uint64_t kVertexExpansion = 64;
/// 2^26: what 4096 x 4096 pixels take uncompressed.
constexpr std::uint64_t kMaxImageBytes = std::uint64_t{1} << 26;
/// What the smallest of payloads may decode to beside 64 times its size: views are rounded up.
constexpr std::uint64_t kFreeBytes = 65536;

std::size_t bytesOf(GltfComponent component) {
  switch (component) {
    case GltfComponent::Byte:
      return 1;
    case GltfComponent::UnsignedShort:
      return 2;
    default:
      return 4;
  }
}

std::string text(std::string_view label) {
  return std::string(label);
}

}  // namespace

Status GltfReader::begin(const GlbChunks& chunks, JsonValue document, std::size_t payloadBytes) {
  chunks_ = chunks;
  accessors_ = document.member("accessors");
  views_ = document.member("bufferViews");
  leftBytes_ = kVertexExpansion * payloadBytes + kFreeBytes;
  TERRAPORT_RETURN_IF_ERROR(expectList(accessors_, "accessors"));
  return expectList(views_, "bufferViews");
}

Status GltfReader::findVertices(JsonValue number, const GltfExpectation& expected, GltfRows& rows) {
  JsonValue view;
  TERRAPORT_RETURN_IF_ERROR(find(number, expected, rows, view));
  const std::size_t width = expected.width * bytesOf(rows.component);
  std::uint64_t stride = 0;
  TERRAPORT_RETURN_IF_ERROR(
      expectWholeOr(view.member("byteStride"), "byteStride", static_cast<std::int64_t>(width), width, stride));
  if (stride > 16 || stride % 4 != 0) {
    return Status::damaged(
        "byteStride of " + text(expected.label) + " is " + std::to_string(stride) + ", expected 4, 8, 12 or 16");
  }
  rows.stride = static_cast<std::size_t>(stride);
  return locate(view, rows);
}

Status GltfReader::findIndices(JsonValue number, GltfRows& rows) {
  const GltfExpectation expected = {"indices", GltfComponent::UnsignedShort, GltfComponent::UnsignedInt, "SCALAR", 1};
  JsonValue view;
  TERRAPORT_RETURN_IF_ERROR(find(number, expected, rows, view));
  if (rows.count % 3 != 0) {
    return Status::damaged(std::to_string(rows.count) + " indices, expected a multiple of 3");
  }
  rows.stride = bytesOf(rows.component);
  rows.isTriangles = true;
  return locate(view, rows);
}

Status GltfReader::findImage(JsonValue number, ByteSpan& bytes, std::size_t& offset) const {
  JsonValue view;
  TERRAPORT_RETURN_IF_ERROR(pickMap(views_, number, "bufferView of image", view));
  std::uint64_t length = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(view.member("byteLength"), "byteLength of image", 1, length));
  if (length > kMaxImageBytes) {
    return Status::damaged("image of " + std::to_string(length) + " bytes, expected at most 2^26");
  }
  const JsonValue extensions = view.member("extensions");
  TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(extensions, "extensions"));
  if (extensions.member(kMeshopt).exists()) {
    return Status::damaged("image is compressed as geometry, expected a file as it is");
  }
  return slice(view, length, "image", bytes, offset);
}

Status GltfReader::find(JsonValue number, const GltfExpectation& expected, GltfRows& rows, JsonValue& view) const {
  JsonValue accessor;
  TERRAPORT_RETURN_IF_ERROR(pickMap(accessors_, number, expected.label, accessor));
  const auto component = accessor.member("componentType").integer();
  const bool isAllowed = component &&
      (*component == static_cast<std::int64_t>(expected.component) ||
          *component == static_cast<std::int64_t>(expected.alternative));
  if (!isAllowed || accessor.member("type").text().value_or("") != expected.type) {
    return Status::damaged(text(expected.label) + " is " + shortly(accessor.member("componentType")) + " " +
        shortly(accessor.member("type")) + ", expected " + text(expected.type) + " of " +
        std::to_string(static_cast<std::uint32_t>(expected.component)));
  }
  std::uint64_t byteOffset = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWholeOr(accessor.member("byteOffset"), "byteOffset of accessor", 0, 0, byteOffset));
  if (byteOffset != 0 || accessor.member("sparse").exists()) {
    return Status::damaged(text(expected.label) + " has an offset inside its bufferView or is sparse, expected neither");
  }
  std::uint64_t count = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(accessor.member("count"), expected.label, 1, count));
  rows = GltfRows();
  rows.count = static_cast<std::size_t>(count);
  rows.component = static_cast<GltfComponent>(*component);
  rows.isNormalised = accessor.member("normalized").boolean().value_or(false);
  rows.label = expected.label;
  return pickMap(views_, accessor.member("bufferView"), "bufferView", view);
}

Status GltfReader::locate(JsonValue view, GltfRows& rows) {
  std::uint64_t length = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(view.member("byteLength"), "byteLength of bufferView", 1, length));
  if (length != std::uint64_t{rows.count} * rows.stride) {
    return Status::damaged("bufferView of " + text(rows.label) + " has " + std::to_string(length) + " bytes, expected " +
        std::to_string(rows.count) + " rows of " + std::to_string(rows.stride));
  }
  const JsonValue extensions = view.member("extensions");
  TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(extensions, "extensions"));
  const JsonValue packed = extensions.member(kMeshopt);
  TERRAPORT_RETURN_IF_ERROR(
      packed.exists() ? locatePacked(packed, rows) : slice(view, length, rows.label, rows.bytes, rows.offset));
  if (length > leftBytes_) {
    return Status::damaged("parts of it are named again and again, expected every bufferView once");
  }
  leftBytes_ -= length;
  return {};
}

Status GltfReader::locatePacked(JsonValue packed, GltfRows& rows) {
  TERRAPORT_RETURN_IF_ERROR(expectMap(packed, kMeshopt));
  const std::string_view mode = rows.isTriangles ? "TRIANGLES" : "ATTRIBUTES";
  const auto count = packed.member("count").integer();
  const auto stride = packed.member("byteStride").integer();
  if (packed.member("mode").text().value_or("") != mode || !count || !stride ||
      *count != static_cast<std::int64_t>(rows.count) || *stride != static_cast<std::int64_t>(rows.stride)) {
    return Status::damaged(text(rows.label) + " is compressed otherwise than as " + std::to_string(rows.count) + " rows of " +
        std::to_string(rows.stride) + " in mode " + text(mode));
  }
  std::uint64_t length = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(packed.member("byteLength"), "compressed byteLength", 1, length));
  const std::uint64_t least = rows.isTriangles ? rows.count / 3 : std::uint64_t{rows.count} * rows.stride / kVertexExpansion;
  if (length < least) {
    return Status::damaged(std::to_string(length) + " compressed bytes for " + std::to_string(rows.count) + " rows of " +
            text(rows.label) + ", expected at least " + std::to_string(least),
        static_cast<std::int64_t>(chunks_.binaryOffset));
  }
  TERRAPORT_RETURN_IF_ERROR(readFilter(packed, rows));
  TERRAPORT_RETURN_IF_ERROR(slice(packed, length, rows.label, rows.bytes, rows.offset));
  const std::uint8_t codec = rows.isTriangles ? kMeshoptIndexCodec : kMeshoptVertexCodec;
  if (rows.bytes.data[0] != codec) {
    return Status::damaged(
        "codec byte " + std::to_string(rows.bytes.data[0]) + " of " + text(rows.label) + ", expected " + std::to_string(codec),
        static_cast<std::int64_t>(rows.offset));
  }
  rows.isCompressed = true;
  return {};
}

Status GltfReader::readFilter(JsonValue packed, GltfRows& rows) const {
  const JsonValue filter = packed.member("filter");
  const std::string_view name = filter.exists() ? filter.text().value_or("") : "NONE";
  rows.isOctahedral = name == "OCTAHEDRAL" && rows.label == "NORMAL" && rows.stride == 4;
  rows.isExponential = name == "EXPONENTIAL" && rows.label == "POSITION";
  if (name == "NONE" || rows.isOctahedral || rows.isExponential) {
    return {};
  }
  return Status::damaged("filter " + shortly(filter) + " of " + text(rows.label) + ", expected none, or the one for it");
}

Status GltfReader::slice(
    JsonValue range, std::uint64_t length, std::string_view label, ByteSpan& bytes, std::size_t& offset) const {
  const JsonValue buffer = range.member("buffer");
  if (buffer.integer().value_or(-1) != 0) {
    return Status::damaged(text(label) + " is in buffer " + shortly(buffer) + ", expected 0 (the BIN chunk)");
  }
  std::uint64_t first = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWholeOr(range.member("byteOffset"), "byteOffset", 0, 0, first));
  if (first > chunks_.binary.size || length > chunks_.binary.size - first) {
    return Status::damaged(text(label) + " lies at " + std::to_string(first) + " with " + std::to_string(length) +
            " bytes, expected within " + std::to_string(chunks_.binary.size),
        static_cast<std::int64_t>(chunks_.binaryOffset));
  }
  bytes = {chunks_.binary.data + first, static_cast<std::size_t>(length)};
  offset = chunks_.binaryOffset + static_cast<std::size_t>(first);
  return {};
}

Status GltfReader::decode(const GltfRows& rows, std::uint8_t* out) {
  if (!rows.isCompressed) {
    std::memcpy(out, rows.bytes.data, rows.bytes.size);
    return {};
  }
  if (!meshoptDecodeVertices(rows.bytes, rows.count, rows.stride, out)) {
    return Status::damaged(text(rows.label) + " does not decompress", static_cast<std::int64_t>(rows.offset));
  }
  if (rows.isOctahedral) {
    meshoptUnfilterOctahedral(out, rows.count);
  }
  if (rows.isExponential) {
    meshoptUnfilterExponential(out, rows.count * rows.stride / 4);
  }
  return {};
}

Status GltfReader::decodeIndices(const GltfRows& rows, std::uint32_t* out) {
  if (rows.isCompressed) {
    if (!meshoptDecodeTriangles(rows.bytes, rows.count, out)) {
      return Status::damaged("indices do not decompress", static_cast<std::int64_t>(rows.offset));
    }
    return {};
  }
  const std::uint8_t* data = rows.bytes.data;
  for (std::size_t at = 0; at < rows.count; ++at) {
    out[at] = rows.component == GltfComponent::UnsignedShort ? readU16(data + at * 2) : readU32(data + at * 4);
  }
  return {};
}

}  // namespace terraport
