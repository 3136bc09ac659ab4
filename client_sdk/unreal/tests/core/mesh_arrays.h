// A decoded mesh as plain arrays: what any client makes of a payload.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "Terraport/SegmentMesh.h"

namespace terraport_tests {

struct MeshArrays {
  std::vector<float> positions;
  std::vector<float> normals;
  std::vector<std::uint32_t> indices;
  std::vector<std::uint8_t> colours;
  std::vector<std::uint16_t> regionIds;
  std::vector<float> uvs;
  std::map<std::string, std::vector<float>> attributes;
};

inline MeshArrays arraysOf(const terraport::SegmentMesh& mesh) {
  MeshArrays out;
  out.positions.resize(mesh.vertexCount * std::size_t{3});
  mesh.writePositions(out.positions.data());
  out.normals.resize(mesh.vertexCount * std::size_t{3});
  mesh.writeNormals(out.normals.data());
  out.indices.assign(mesh.indices.begin(), mesh.indices.end());
  out.colours.assign(mesh.colours.begin(), mesh.colours.end());
  if (mesh.hasRegionIds) {
    out.regionIds.assign(mesh.regionIds.begin(), mesh.regionIds.end());
  }
  if (mesh.hasUvs) {
    out.uvs.resize(mesh.vertexCount * std::size_t{2});
    mesh.writeUvs(out.uvs.data());
  }
  for (std::size_t at = 0; at < mesh.attributeCount; ++at) {
    std::vector<float>& values = out.attributes[mesh.attributes[at].name];
    values.resize(mesh.vertexCount);
    mesh.writeAttribute(at, values.data());
  }
  return out;
}

}  // namespace terraport_tests
