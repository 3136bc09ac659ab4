#include "Terraport/ArraysDecoder.h"

#include <cstring>
#include <string>
#include <string_view>

#include "FlatFile.h"
#include "ImageHeader.h"
#include "MeshChecks.h"

namespace terraport {
namespace {

constexpr std::string_view kAttribute = "attribute/";

/// Rows that are not counted by the header.
constexpr std::int64_t kAnyRows = -1;

/// Look for a field: null where there is none, a failure where it has another type or shape.
Status findField(const FlatFile& file, std::string_view name, FlatType type, std::uint32_t components, std::int64_t rows,
                 const FlatField*& field) {
  field = file.find(name);
  if (field == nullptr) {
    return {};
  }
  if (field->type != type || field->components != components || (rows != kAnyRows && field->rows != rows)) {
    return Status::damaged("field \"" + std::string(name) + "\" has another type or shape than it must: " +
                           std::to_string(field->rows) + " x " + std::to_string(field->components));
  }
  return {};
}

template <typename T>
Status copyField(const FlatField& field, SegmentBuffer<T>& out) {
  if (!out.resize(field.bytes.size / sizeof(T))) {
    return Status::failed("out_of_memory", "no memory for a payload's arrays");
  }
  if (field.bytes.size > 0) {
    std::memcpy(out.data(), field.bytes.data, field.bytes.size);
  }
  return {};
}

Status missing(std::string_view name) { return Status::damaged("no field \"" + std::string(name) + "\""); }

Status readGeometry(const FlatFile& file, SegmentMesh& mesh) {
  const std::uint32_t vertices = file.rows();
  const FlatField* positions = nullptr;
  const FlatField* normals = nullptr;
  const FlatField* indices = nullptr;
  TERRAPORT_RETURN_IF_ERROR(findField(file, "positions", FlatType::Float32, 3, vertices, positions));
  TERRAPORT_RETURN_IF_ERROR(findField(file, "normals", FlatType::Float32, 3, vertices, normals));
  TERRAPORT_RETURN_IF_ERROR(findField(file, "indices", FlatType::Uint32, 3, kAnyRows, indices));
  if (positions == nullptr || normals == nullptr || indices == nullptr) {
    return missing(positions == nullptr ? "positions" : (normals == nullptr ? "normals" : "indices"));
  }
  if (vertices == 0 || indices->rows == 0) {
    return Status::damaged(std::to_string(vertices) + " vertices and " + std::to_string(indices->rows) +
                           " faces, expected at least one face");
  }
  mesh.vertexCount = vertices;
  mesh.faceCount = indices->rows;
  mesh.positionForm = mesh.normalForm = mesh.uvForm = VertexForm::Floats;
  TERRAPORT_RETURN_IF_ERROR(copyField(*positions, mesh.positions));
  TERRAPORT_RETURN_IF_ERROR(placeBounds(mesh));
  TERRAPORT_RETURN_IF_ERROR(copyField(*indices, mesh.indices));
  TERRAPORT_RETURN_IF_ERROR(checkIndices(mesh));
  TERRAPORT_RETURN_IF_ERROR(copyField(*normals, mesh.normals));
  return checkNormals(mesh);
}

Status readTexture(const FlatFile& file, ByteSpan payload, SegmentMesh& mesh) {
  const FlatField* uvs = nullptr;
  const FlatField* texture = nullptr;
  TERRAPORT_RETURN_IF_ERROR(findField(file, "uvs", FlatType::Float32, 2, mesh.vertexCount, uvs));
  TERRAPORT_RETURN_IF_ERROR(findField(file, "texture", FlatType::Uint8, 1, kAnyRows, texture));
  if ((uvs == nullptr) != (texture == nullptr)) {
    return Status::damaged(uvs == nullptr ? "a mesh with texture and without uvs, expected both or neither"
                                          : "a mesh with uvs and without texture, expected both or neither");
  }
  if (uvs == nullptr) {
    return {};
  }
  if (mesh.colourForm != ColourForm::None) {
    return Status::damaged("a mesh with texture and vertex colours, expected one of them");
  }
  mesh.hasUvs = true;
  TERRAPORT_RETURN_IF_ERROR(copyField(*uvs, mesh.uvs));
  TERRAPORT_RETURN_IF_ERROR(checkUvs(mesh));
  ImageHeader header;
  TERRAPORT_RETURN_IF_ERROR(readPayloadImage(texture->bytes, mesh.segment < 0, header));
  mesh.image = {header.type, header.width, header.height, static_cast<std::size_t>(texture->bytes.data - payload.data),
                texture->bytes.size};
  return {};
}

Status readAttributes(const FlatFile& file, SegmentMesh& mesh) {
  for (std::size_t at = 0; at < file.fieldCount(); ++at) {
    const std::string_view name = file.field(at).name;
    if (name.substr(0, kAttribute.size()) != kAttribute) {
      continue;
    }
    const FlatField* field = nullptr;
    TERRAPORT_RETURN_IF_ERROR(findField(file, name, FlatType::Float32, 1, mesh.vertexCount, field));
    if (mesh.attributeCount == mesh.attributes.size()) {
      mesh.attributes.emplace_back();
    }
    AttributeColumn& column = mesh.attributes[mesh.attributeCount];
    ++mesh.attributeCount;
    column.name.assign(name.data() + kAttribute.size(), name.size() - kAttribute.size());
    column.form = VertexForm::Floats;
    column.offset = 0.0;
    column.step = 1.0;
    TERRAPORT_RETURN_IF_ERROR(copyField(*field, column.values));
  }
  return {};
}

}  // namespace

ArraysDecoder::ArraysDecoder() : file_(new FlatFile) {}

ArraysDecoder::~ArraysDecoder() = default;

Status ArraysDecoder::decode(ByteSpan payload, std::int64_t segment, SegmentMesh& mesh) {
  mesh.clear();
  mesh.segment = segment;
  Status status = read(payload, mesh);
  if (!status.isOk()) {
    mesh.clear();
  }
  return status;
}

Status ArraysDecoder::read(ByteSpan payload, SegmentMesh& mesh) {
  TERRAPORT_RETURN_IF_ERROR(file_->read(payload, "TPARRAYS"));
  TERRAPORT_RETURN_IF_ERROR(readGeometry(*file_, mesh));
  const FlatField* colours = nullptr;
  const FlatField* regions = nullptr;
  TERRAPORT_RETURN_IF_ERROR(findField(*file_, "colours", FlatType::Uint8, 4, mesh.vertexCount, colours));
  TERRAPORT_RETURN_IF_ERROR(findField(*file_, "region_ids", FlatType::Uint16, 1, mesh.vertexCount, regions));
  if (colours != nullptr) {
    mesh.colourForm = ColourForm::Srgb8;
    TERRAPORT_RETURN_IF_ERROR(copyField(*colours, mesh.coloursSrgb8));
  }
  if (regions != nullptr) {
    mesh.hasRegionIds = true;
    TERRAPORT_RETURN_IF_ERROR(copyField(*regions, mesh.regionIds));
  }
  TERRAPORT_RETURN_IF_ERROR(readTexture(*file_, payload, mesh));
  return readAttributes(*file_, mesh);
}

}  // namespace terraport
