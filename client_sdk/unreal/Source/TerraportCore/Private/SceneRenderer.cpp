#include "Terraport/SceneRenderer.h"

namespace terraport {

std::size_t SceneRenderer::gpuBytesOf(const SegmentMesh& mesh) const {
  std::size_t vertex = (mesh.positionForm == VertexForm::Codes ? 8 : 12) + 4;
  vertex += mesh.hasColours ? 4 : 0;
  vertex += mesh.hasUvs ? 4 : 0;
  vertex += mesh.hasRegionIds ? 4 : 0;
  vertex += 4 * mesh.attributeCount;
  const std::size_t index = mesh.maxIndex < 65536 ? 2 : 4;
  return vertex * mesh.vertexCount + index * mesh.indices.size() + mesh.image.gpuBytes();
}

}  // namespace terraport
