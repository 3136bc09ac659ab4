#include "mesh_arrays.h"

#include <cmath>
#include <cstdio>
#include <cstring>

#include "Terraport/Xxh3.h"
#include "files.h"

namespace terraport::tools {
namespace {

/// "No value" has many bit patterns; the canonical one is 0x7FC00000.
std::vector<float> withCanonicalNan(std::vector<float> values) {
  for (float& value : values) {
    if (std::isnan(value)) {
      const std::uint32_t bits = 0x7FC00000U;
      std::memcpy(&value, &bits, sizeof value);
    }
  }
  return values;
}

}  // namespace

MeshArrays::MeshArrays(const SegmentMesh& mesh, ByteSpan payload) : vertexCount(mesh.vertexCount), faceCount(mesh.faceCount) {
  const std::size_t count = mesh.vertexCount;
  positions.resize(3 * count);
  mesh.writePositions(positions.data());
  indices.assign(mesh.indices.data(), mesh.indices.data() + 3 * std::size_t{mesh.faceCount});
  normals.resize(3 * count);
  mesh.writeNormals(normals.data());
  hasColours = mesh.hasColours;
  for (std::size_t at = 0; at < mesh.colours.size(); ++at) {
    if (at % 4 != 3) {
      colours.push_back(mesh.colours[at]);
    }
  }
  hasRegionIds = mesh.hasRegionIds;
  if (hasRegionIds) {
    regionIds.assign(mesh.regionIds.data(), mesh.regionIds.data() + count);
  }
  hasUvs = mesh.hasUvs;
  if (hasUvs) {
    uvs.resize(2 * count);
    mesh.writeUvs(uvs.data());
    image.assign(payload.data + mesh.image.offset, payload.data + mesh.image.offset + mesh.image.bytes);
    mediaType = mediaTypeOf(mesh.image.type);
    width = mesh.image.width;
    height = mesh.image.height;
  }
  for (std::size_t column = 0; column < mesh.attributeCount; ++column) {
    std::vector<float> values(count);
    mesh.writeAttribute(column, values.data());
    attributes.emplace_back(mesh.attributes[column].name, withCanonicalNan(std::move(values)));
  }
}

void MeshArrays::describe(JsonText& json, const std::string& folder, std::uint32_t segment) const {
  const auto digest = [&json](const char* name, bool exists, const void* data, std::size_t size) {
    json.key(name);
    if (exists) {
      json.text(digestOf(data, size));
    } else {
      json.null();
    }
  };
  json.open('{');
  json.key("vertices").integer(vertexCount).key("faces").integer(faceCount);
  digest("positions", true, positions.data(), 4 * positions.size());
  digest("indices", true, indices.data(), 4 * indices.size());
  digest("colours", hasColours, colours.data(), colours.size());
  digest("region_ids", hasRegionIds, regionIds.data(), 2 * regionIds.size());
  digest("uvs", hasUvs, uvs.data(), 4 * uvs.size());
  digest("image", !image.empty(), image.data(), image.size());
  json.key("media_type");
  if (mediaType.empty()) {
    json.null();
  } else {
    json.text(mediaType);
  }
  json.key("width").integer(width).key("height").integer(height);
  json.key("attributes").open('{');
  for (const auto& [name, values] : attributes) {
    digest(name.c_str(), true, values.data(), 4 * values.size());
  }
  json.close('}').close('}');
  if (!folder.empty()) {
    writeFile(folder + "/" + std::to_string(segment) + ".normals", normals.data(), 4 * normals.size());
  }
}

std::string digestOf(const void* data, std::size_t size) {
  char digits[17];
  const auto hash = xxh3Hash64(ByteSpan{static_cast<const std::uint8_t*>(data), size});
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(hash));
  return digits;
}

}  // namespace terraport::tools
