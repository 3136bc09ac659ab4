#include "MeshChecks.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace terraport {
namespace {

/// Lowest and highest of each of three components.
template <typename T>
struct Extent {
  T low[3];
  T high[3];
};

template <typename T>
Extent<T> extentOf(const T* values, std::size_t count, std::size_t width) {
  Extent<T> extent;
  for (int axis = 0; axis < 3; ++axis) {
    extent.low[axis] = extent.high[axis] = values[axis];
  }
  for (std::size_t row = 0; row < count; ++row, values += width) {
    for (int axis = 0; axis < 3; ++axis) {
      extent.low[axis] = std::min(extent.low[axis], values[axis]);
      extent.high[axis] = std::max(extent.high[axis], values[axis]);
    }
  }
  return extent;
}

/// Zero times a finite number is zero; a NaN or an infinity makes NaN, and stays. (Comparisons would pass over a NaN.)
bool areFinite(const float* values, std::size_t count) {
  float sum = 0.0F;
  for (std::size_t at = 0; at < count; ++at) {
    sum += 0.0F * values[at];
  }
  return sum == 0.0F;
}

}  // namespace

Status checkIndices(SegmentMesh& mesh) {
  std::uint32_t most = 0;
  for (const std::uint32_t index : mesh.indices) {
    most = std::max(most, index);
  }
  mesh.maxIndex = most;
  if (most >= mesh.vertexCount) {
    return Status::damaged(
        "a face uses vertex " + std::to_string(most) + ", expected below " + std::to_string(mesh.vertexCount));
  }
  return {};
}

Status checkNormals(const SegmentMesh& mesh) {
  const std::int8_t* normal = mesh.normalCodes.data();
  for (std::uint32_t vertex = 0; vertex < mesh.vertexCount; ++vertex, normal += 4) {
    if ((normal[0] | normal[1] | normal[2]) == 0) {
      return Status::damaged("normal " + std::to_string(vertex) + " has length 0, expected 1");
    }
  }
  return {};
}

Status computeBounds(SegmentMesh& mesh) {
  float low[3];
  float high[3];
  if (mesh.positionForm == VertexForm::Floats) {
    if (!areFinite(mesh.positions.data(), mesh.positions.size())) {
      return Status::damaged("a position is not finite, expected finite numbers");
    }
    const Extent<float> extent = extentOf(mesh.positions.data(), mesh.vertexCount, 3);
    std::copy(extent.low, extent.low + 3, low);
    std::copy(extent.high, extent.high + 3, high);
  } else {
    const Extent<std::uint16_t> extent = extentOf(mesh.positionCodes.data(), mesh.vertexCount, 4);
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = static_cast<float>(mesh.translation[axis] + mesh.stepM * extent.low[axis]);
      high[axis] = static_cast<float>(mesh.translation[axis] + mesh.stepM * extent.high[axis]);
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(low[axis]) || !std::isfinite(high[axis])) {
      return Status::damaged("a position beyond float32, expected finite numbers");
    }
  }
  mesh.bounds = {low[0], low[1], low[2], high[0], high[1], high[2]};
  return {};
}

Status checkUvs(const SegmentMesh& mesh) {
  bool isInside = true;
  if (!mesh.uvsNormalised) {
    // Codes over all 16 bits cannot leave the image.
    std::uint16_t most[2] = {0, 0};
    for (std::size_t at = 0; at + 1 < mesh.uvCodes.size(); at += 2) {
      most[0] = std::max(most[0], mesh.uvCodes[at]);
      most[1] = std::max(most[1], mesh.uvCodes[at + 1]);
    }
    isInside = most[0] * mesh.uvScale[0] <= 1.0F && most[1] * mesh.uvScale[1] <= 1.0F;
  }
  return isInside ? Status() : Status::damaged("texture coordinates beyond the image, expected 0 to 1");
}

}  // namespace terraport
