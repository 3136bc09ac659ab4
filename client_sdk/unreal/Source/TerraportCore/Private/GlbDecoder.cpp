#include "Terraport/GlbDecoder.h"

#include <cstring>
#include <string>
#include <string_view>

#include "GlbAccessors.h"
#include "GlbContainer.h"
#include "GlbTexture.h"
#include "ImageHeader.h"
#include "JsonExpect.h"
#include "LittleEndian.h"
#include "MeshChecks.h"

namespace terraport {
namespace {

constexpr std::int64_t kStatedNullCode = 65535;
/// More than any survey has: bounds what the names of one payload take.
constexpr std::uint32_t kMaxPayloadAttributes = 240;
constexpr std::string_view kSupportedExtensions[] = {"KHR_mesh_quantization", "EXT_meshopt_compression", "EXT_mesh_features",
    "KHR_texture_transform", "EXT_texture_webp", "KHR_texture_basisu"};

JsonLimits glbJson() {
  JsonLimits limits;
  limits.maxBytes = std::size_t{1} << 20;
  limits.maxValues = 1U << 16;
  return limits;
}

Status noMemory() {
  return Status::failed("out_of_memory", "no memory for a payload's arrays");
}

}  // namespace

/// One payload being read.
class GlbReading {
 public:
  GlbReading(GlbDecoder& decoder, SegmentMesh& mesh) : decoder_(decoder), mesh_(mesh) {}

  Status read(ByteSpan payload) {
    GlbChunks chunks;
    TERRAPORT_RETURN_IF_ERROR(splitGlb(payload, chunks));
    const Status parsed = decoder_.document_.read(chunks.json, glbJson());
    if (!parsed.isOk()) {
      return Status::damaged("JSON chunk does not parse: " + parsed.message(), static_cast<std::int64_t>(chunks.jsonOffset));
    }
    document_ = decoder_.document_.root();
    TERRAPORT_RETURN_IF_ERROR(expectMap(document_, "JSON chunk"));
    TERRAPORT_RETURN_IF_ERROR(readExtensions());
    JsonValue mesh;
    TERRAPORT_RETURN_IF_ERROR(onlyMap(document_, "meshes", mesh));
    TERRAPORT_RETURN_IF_ERROR(onlyMap(mesh, "primitives", primitive_));
    std::uint64_t mode = 0;
    TERRAPORT_RETURN_IF_ERROR(expectWholeOr(primitive_.member("mode"), "primitive mode", 0, 4, mode));
    if (mode != 4) {
      return Status::damaged("primitive mode " + std::to_string(mode) + ", expected 4 (triangles)");
    }
    names_ = primitive_.member("attributes");
    TERRAPORT_RETURN_IF_ERROR(expectMap(names_, "attributes"));
    TERRAPORT_RETURN_IF_ERROR(reader_.begin(chunks, document_, payload.size));
    TERRAPORT_RETURN_IF_ERROR(readTransform());
    TERRAPORT_RETURN_IF_ERROR(readPositions());
    TERRAPORT_RETURN_IF_ERROR(readIndices());
    TERRAPORT_RETURN_IF_ERROR(readNormals());
    TERRAPORT_RETURN_IF_ERROR(readTexture());
    TERRAPORT_RETURN_IF_ERROR(readColours());
    TERRAPORT_RETURN_IF_ERROR(readRegions());
    return readAttributes(mesh);
  }

 private:
  Status readExtensions() const {
    const JsonValue required = document_.member("extensionsRequired");
    TERRAPORT_RETURN_IF_ERROR(expectListOrAbsent(required, "extensionsRequired"));
    for (const JsonValue name : required.items()) {
      bool isSupported = false;
      for (const std::string_view extension : kSupportedExtensions) {
        isSupported = isSupported || name.text().value_or("") == extension;
      }
      if (!isSupported) {
        return Status::damaged("required extension " + shortly(name) + ", expected one that we know");
      }
    }
    return {};
  }

  Status readTransform() {
    JsonValue node;
    TERRAPORT_RETURN_IF_ERROR(onlyMap(document_, "nodes", node));
    if (node.member("matrix").exists() || node.member("rotation").exists()) {
      return Status::damaged("node has a matrix or rotation, expected translation and scale alone");
    }
    if (node.member("translation").exists()) {
      TERRAPORT_RETURN_IF_ERROR(expectTriple(node.member("translation"), "translation", mesh_.translation));
    }
    double scale[3] = {1.0, 1.0, 1.0};
    if (node.member("scale").exists()) {
      TERRAPORT_RETURN_IF_ERROR(expectTriple(node.member("scale"), "scale", scale));
    }
    if (!(scale[0] > 0.0) || scale[1] != scale[0] || scale[2] != scale[0]) {
      return Status::damaged("node scale, expected one positive number three times");
    }
    mesh_.stepM = scale[0];
    return {};
  }

  /// Decode rows into memory of the decoder; `rows_` of it are then there.
  Status decodeRows(const GltfRows& rows) {
    if (!decoder_.rows_.resize(rows.count * rows.stride)) {
      return noMemory();
    }
    return GltfReader::decode(rows, decoder_.rows_.data());
  }

  /// Decode rows to `stride` bytes each, straight into `out` where they are stored like that, as in everything that we write.
  template <typename T>
  Status decodeInto(const GltfRows& rows, std::size_t stride, SegmentBuffer<T>& out) {
    if (!out.resize(rows.count * stride / sizeof(T))) {
      return noMemory();
    }
    std::uint8_t* target = reinterpret_cast<std::uint8_t*>(out.data());
    if (rows.stride == stride) {
      return GltfReader::decode(rows, target);
    }
    TERRAPORT_RETURN_IF_ERROR(decodeRows(rows));
    const std::uint8_t* from = decoder_.rows_.data();
    const std::size_t copied = rows.stride < stride ? rows.stride : stride;
    for (std::size_t row = 0; row < rows.count; ++row, from += rows.stride, target += stride) {
      std::memset(target + copied, 0, stride - copied);
      std::memcpy(target, from, copied);
    }
    return {};
  }

  Status readPositions() {
    const GltfExpectation expected = {"POSITION", GltfComponent::UnsignedShort, GltfComponent::Float, "VEC3", 3};
    GltfRows rows;
    TERRAPORT_RETURN_IF_ERROR(reader_.findVertices(names_.member("POSITION"), expected, rows));
    mesh_.vertexCount = static_cast<std::uint32_t>(rows.count);
    if (rows.component == GltfComponent::UnsignedShort) {
      TERRAPORT_RETURN_IF_ERROR(decodeInto(rows, 8, mesh_.positionCodes));
      return computeBounds(mesh_);
    }
    const double* move = mesh_.translation;
    if (mesh_.stepM != 1.0 || move[0] != 0.0 || move[1] != 0.0 || move[2] != 0.0) {
      return Status::damaged("float positions with a node transform, expected none");
    }
    mesh_.positionForm = VertexForm::Floats;
    TERRAPORT_RETURN_IF_ERROR(decodeInto(rows, 12, mesh_.positions));
    return computeBounds(mesh_);
  }

  Status readIndices() {
    GltfRows rows;
    TERRAPORT_RETURN_IF_ERROR(reader_.findIndices(primitive_.member("indices"), rows));
    if (!mesh_.indices.resize(rows.count)) {
      return noMemory();
    }
    mesh_.faceCount = static_cast<std::uint32_t>(rows.count / 3);
    TERRAPORT_RETURN_IF_ERROR(GltfReader::decodeIndices(rows, mesh_.indices.data()));
    TERRAPORT_RETURN_IF_ERROR(checkIndices(mesh_));
    if (rows.component == GltfComponent::UnsignedShort && mesh_.maxIndex > 65535) {
      return Status::damaged("a face uses vertex " + std::to_string(mesh_.maxIndex) + ", expected 16-bit numbers");
    }
    return {};
  }

  /// Check a vertex attribute that must have one row for each vertex.
  Status findColumn(const GltfExpectation& expected, GltfRows& rows) {
    TERRAPORT_RETURN_IF_ERROR(reader_.findVertices(names_.member(expected.label), expected, rows));
    if (rows.count != mesh_.vertexCount) {
      return Status::damaged(std::string(expected.label) + " has " + std::to_string(rows.count) + " rows, expected " +
          std::to_string(mesh_.vertexCount) + ": one a vertex");
    }
    return {};
  }

  Status readNormals() {
    GltfRows rows;
    TERRAPORT_RETURN_IF_ERROR(findColumn({"NORMAL", GltfComponent::Byte, GltfComponent::Byte, "VEC3", 3}, rows));
    TERRAPORT_RETURN_IF_ERROR(decodeInto(rows, 4, mesh_.normalCodes));
    return checkNormals(mesh_);
  }

  Status readTexture() {
    GlbTexture texture;
    TERRAPORT_RETURN_IF_ERROR(findGlbTexture(document_, primitive_, texture));
    if (texture.type == ImageType::None) {
      return {};
    }
    if (names_.member("COLOR_0").exists()) {
      return Status::damaged("texture and COLOR_0 in one mesh, expected one of them (glTF multiplies)");
    }
    const GltfExpectation expected = {"TEXCOORD_0", GltfComponent::UnsignedShort, GltfComponent::UnsignedShort, "VEC2", 2};
    GltfRows rows;
    TERRAPORT_RETURN_IF_ERROR(findColumn(expected, rows));
    if (texture.hasScale == rows.isNormalised) {
      return Status::damaged("TEXCOORD_0 must be normalised without a transform, and not with one");
    }
    mesh_.hasUvs = true;
    mesh_.uvsNormalised = rows.isNormalised;
    mesh_.uvScale[0] = rows.isNormalised ? 1.0F / 65535.0F : texture.uvScale[0];
    mesh_.uvScale[1] = rows.isNormalised ? 1.0F / 65535.0F : texture.uvScale[1];
    TERRAPORT_RETURN_IF_ERROR(decodeInto(rows, 4, mesh_.uvCodes));
    TERRAPORT_RETURN_IF_ERROR(checkUvs(mesh_));
    return readImage(texture);
  }

  Status readImage(const GlbTexture& texture) {
    ByteSpan file;
    std::size_t offset = 0;
    TERRAPORT_RETURN_IF_ERROR(reader_.findImage(texture.view, file, offset));
    ImageHeader header;
    TERRAPORT_RETURN_IF_ERROR(readPayloadImage(file, true, header));
    if (header.type != texture.type) {
      return Status::damaged(
          std::string("image is ") + mediaTypeOf(header.type) + ", expected " + mediaTypeOf(texture.type) + " by mimeType");
    }
    mesh_.image = {header.type, header.width, header.height, header.texelBits, offset, file.size};
    return {};
  }

  Status readColours() {
    if (!names_.member("COLOR_0").exists()) {
      return {};
    }
    const GltfExpectation expected = {"COLOR_0", GltfComponent::UnsignedShort, GltfComponent::UnsignedShort, "VEC4", 4};
    GltfRows rows;
    TERRAPORT_RETURN_IF_ERROR(findColumn(expected, rows));
    TERRAPORT_RETURN_IF_ERROR(decodeRows(rows));
    mesh_.hasColours = true;
    if (!mesh_.colours.resize(4 * rows.count)) {
      return noMemory();
    }
    for (std::size_t row = 0; row < rows.count; ++row) {
      const std::uint8_t* codes = decoder_.rows_.data() + row * rows.stride;
      std::uint8_t* rgba = mesh_.colours.data() + 4 * row;
      for (int channel = 0; channel < 3; ++channel) {
        rgba[channel] = srgbOfLinear16(readU16(codes + 2 * channel));
      }
      rgba[3] = 255;
    }
    return {};
  }

  /// A column of 16-bit numbers, one for each vertex.
  Status readScalars(std::string_view label, SegmentBuffer<std::uint16_t>& out) {
    GltfRows rows;
    const GltfExpectation expected = {label, GltfComponent::UnsignedShort, GltfComponent::UnsignedShort, "SCALAR", 1};
    TERRAPORT_RETURN_IF_ERROR(findColumn(expected, rows));
    return decodeInto(rows, 2, out);
  }

  Status readRegions() {
    mesh_.hasRegionIds = names_.member("_FEATURE_ID_0").exists();
    return mesh_.hasRegionIds ? readScalars("_FEATURE_ID_0", mesh_.regionIds) : Status();
  }

  Status readAttributes(JsonValue mesh) {
    const JsonValue extras = mesh.member("extras");
    TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(extras, "extras"));
    const JsonValue terraportExtras = extras.member("terraport");
    TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(terraportExtras, "extras.terraport"));
    const JsonValue list = terraportExtras.member("attributes");
    TERRAPORT_RETURN_IF_ERROR(expectListOrAbsent(list, "extras.terraport.attributes"));
    if (list.size() > kMaxPayloadAttributes) {
      return Status::damaged(
          std::to_string(list.size()) + " attributes, expected at most " + std::to_string(kMaxPayloadAttributes));
    }
    for (const JsonValue row : list.items()) {
      TERRAPORT_RETURN_IF_ERROR(expectMap(row, "attribute"));
      TERRAPORT_RETURN_IF_ERROR(readAttribute(row));
    }
    return {};
  }

  Status readAttribute(JsonValue row) {
    const auto name = row.member("name").text();
    const auto gltfName = row.member("gltf_name").text();
    if (!name || !gltfName || gltfName->empty() || gltfName->front() != '_') {
      return Status::damaged("attribute names " + shortly(row.member("name")) + ", " + shortly(row.member("gltf_name")) +
          ", expected text and _TEXT");
    }
    const JsonValue null = row.member("null");
    if (null.exists() && null.integer().value_or(-1) != kStatedNullCode) {
      return Status::damaged("null code " + shortly(null) + " of an attribute, expected 65535");
    }
    double offset = 0.0;
    double step = 0.0;
    TERRAPORT_RETURN_IF_ERROR(expectScale(row, offset, step));
    for (std::size_t at = 0; at < mesh_.attributeCount; ++at) {
      if (mesh_.attributes[at].name == *name) {
        return Status::damaged("attribute " + shortly(row.member("name")) + " stands twice, expected once");
      }
    }
    if (mesh_.attributeCount == mesh_.attributes.size()) {
      mesh_.attributes.emplace_back();
    }
    AttributeColumn& column = mesh_.attributes[mesh_.attributeCount];
    ++mesh_.attributeCount;
    column.name.assign(name->data(), name->size());
    column.offset = offset;
    column.step = step;
    return readScalars(*gltfName, column.codes);
  }

  GlbDecoder& decoder_;
  SegmentMesh& mesh_;
  JsonValue document_;
  JsonValue primitive_;
  JsonValue names_;
  GltfReader reader_;
};

Status GlbDecoder::decode(ByteSpan payload, SegmentMesh& mesh) {
  mesh.clear();
  GlbReading reading(*this, mesh);
  Status status = reading.read(payload);
  if (!status.isOk()) {
    mesh.clear();
  }
  return status;
}

}  // namespace terraport
