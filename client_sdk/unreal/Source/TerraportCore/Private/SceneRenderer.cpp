#include "Terraport/SceneRenderer.h"

namespace terraport {

std::size_t SceneRenderer::gpuBytesOf(const SegmentMesh& mesh) const {
  std::size_t vertex = (mesh.positionForm == VertexForm::Codes ? 8 : 12) + (mesh.normalForm == VertexForm::Codes ? 4 : 12);
  vertex += mesh.colourForm == ColourForm::None ? 0 : (mesh.colourForm == ColourForm::Linear16 ? 8 : 4);
  vertex += mesh.hasUvs ? (mesh.uvForm == VertexForm::Codes ? 4 : 8) : 0;
  vertex += mesh.hasRegionIds ? 4 : 0;
  vertex += 4 * mesh.attributeCount;
  const std::size_t index = mesh.maxIndex < 65536 ? 2 : 4;
  // Uncompressed, with mips.
  const std::size_t image = std::size_t{4} * mesh.image.width * mesh.image.height * 4 / 3;
  return vertex * mesh.vertexCount + index * mesh.indices.size() + image;
}

}  // namespace terraport
