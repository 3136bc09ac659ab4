// Touches everything that a decoded mesh promises, so that a sanitizer sees what is not there.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport_fuzz {

/// A promise that does not hold ends the program: the fuzzer keeps the input.
inline void require(bool isSo) {
  if (!isSo) {
    std::abort();
  }
}

inline void walk(const terraport::Status& status, const terraport::SegmentMesh& mesh, terraport::ByteSpan payload) {
  if (!status.isOk()) {
    require(!status.message().empty() && mesh.vertexCount == 0 && mesh.indices.empty());
    return;
  }
  require(mesh.vertexCount > 0 && mesh.faceCount > 0 && mesh.indices.size() == std::size_t{mesh.faceCount} * 3);
  require(mesh.maxIndex < mesh.vertexCount);
  std::vector<float> triples(std::size_t{mesh.vertexCount} * 3);
  mesh.writePositions(triples.data());
  for (std::size_t at = 0; at < triples.size(); ++at) {
    require(std::isfinite(triples[at]));
  }
  require(triples[0] >= mesh.bounds.minX && triples[0] <= mesh.bounds.maxX);
  for (const std::uint32_t index : mesh.indices) {
    require(std::isfinite(triples[std::size_t{index} * 3]));
  }
  mesh.writeNormals(triples.data());
  require(mesh.colours.size() == (mesh.hasColours ? std::size_t{mesh.vertexCount} * 4 : 0));
  if (mesh.hasRegionIds) {
    require(mesh.regionIds.size() == mesh.vertexCount);
  }
  if (mesh.hasUvs) {
    mesh.writeUvs(triples.data());
    for (std::size_t at = 0; at < std::size_t{mesh.vertexCount} * 2; ++at) {
      require(triples[at] >= 0.0F && triples[at] <= 1.0F);
    }
    require(mesh.image.offset <= payload.size && mesh.image.bytes <= payload.size - mesh.image.offset);
    require(mesh.image.width <= 4096 && mesh.image.height <= 4096);
  }
  for (std::size_t column = 0; column < mesh.attributeCount; ++column) {
    mesh.writeAttribute(column, triples.data());
  }
}

}  // namespace terraport_fuzz
