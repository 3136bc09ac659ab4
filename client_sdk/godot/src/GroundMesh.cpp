#include "GroundMesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace terraport::godot {

namespace {

constexpr std::size_t kBoxFaces = 64;

Vec3 minus(const Vec3& a, const Vec3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
double dot(const Vec3& a, const Vec3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
Vec3 wide(const Float3& a) {
  return {a.x, a.y, a.z};
}

}  // namespace

/// The slabs of the three axes (Kay and Kajiya, 1986).
bool GroundMesh::Bounds::isEntered(const Vec3& origin, const Vec3& direction, double maxAt) const {
  const double from[3] = {origin.x, origin.y, origin.z};
  const double along[3] = {direction.x, direction.y, direction.z};
  double enter = 0.0;
  double leave = maxAt;
  for (int axis = 0; axis < 3; ++axis) {
    if (along[axis] == 0.0) {
      if (from[axis] < least[axis] || from[axis] > most[axis]) return false;
      continue;
    }
    const double first = (least[axis] - from[axis]) / along[axis];
    const double second = (most[axis] - from[axis]) / along[axis];
    enter = std::max(enter, std::min(first, second));
    leave = std::min(leave, std::max(first, second));
  }
  return enter <= leave;
}

GroundMesh::GroundMesh(std::vector<Float3> positions, std::vector<std::uint32_t> corners)
    : positions_(std::move(positions)), corners_(std::move(corners)) {
  const std::size_t faces = corners_.size() / 3;
  whole_ = boundsOf(0, faces);
  for (std::size_t first = 0; first < faces; first += kBoxFaces) {
    boxes_.push_back(boundsOf(first, std::min(first + kBoxFaces, faces)));
  }
}

GroundMesh::Bounds GroundMesh::boundsOf(std::size_t firstFace, std::size_t endFace) const {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Bounds bounds = {{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
  for (std::size_t corner = 3 * firstFace; corner < 3 * endFace; ++corner) {
    const Float3& position = positions_[corners_[corner]];
    const double parts[3] = {position.x, position.y, position.z};
    for (int axis = 0; axis < 3; ++axis) {
      bounds.least[axis] = std::min(bounds.least[axis], parts[axis]);
      bounds.most[axis] = std::max(bounds.most[axis], parts[axis]);
    }
  }
  return bounds;
}

bool GroundMesh::cast(const Vec3& origin, const Vec3& direction, double maxAt, GroundPoint& point) const {
  // 1. The box around everything: most meshes of a scene end here.
  if (corners_.empty() || !whole_.isEntered(origin, direction, maxAt)) return false;
  bool isHit = false;
  for (std::size_t box = 0; box < boxes_.size(); ++box) {
    // 2. The boxes of consecutive faces.
    if (!boxes_[box].isEntered(origin, direction, maxAt)) continue;
    const std::size_t end = std::min((box + 1) * kBoxFaces, corners_.size() / 3);
    for (std::size_t face = box * kBoxFaces; face < end; ++face) {
      // 3. Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997; both sides of the face count.
      const Vec3 a = wide(positions_[corners_[3 * face]]);
      const Vec3 u = minus(wide(positions_[corners_[3 * face + 1]]), a);
      const Vec3 v = minus(wide(positions_[corners_[3 * face + 2]]), a);
      const Vec3 p = cross(direction, v);
      const double determinant = dot(u, p);
      if (determinant == 0.0) continue;
      const Vec3 t = minus(origin, a);
      const double beta = dot(t, p) / determinant;
      const Vec3 q = cross(t, u);
      const double gamma = dot(direction, q) / determinant;
      const double at = dot(v, q) / determinant;
      if (beta < 0.0 || gamma < 0.0 || beta + gamma > 1.0 || !(at > 0.0 && at <= maxAt)) continue;
      // 4. The nearest so far.
      const Vec3 front = cross(u, v);
      const double length = std::sqrt(dot(front, front));
      point.at = at;
      point.normal = {front.x / length, front.y / length, front.z / length};
      maxAt = at;
      isHit = true;
    }
  }
  return isHit;
}

Variant GroundMesh::faces() const {
  return arrayOf<Float3>(corners_.size(), [this](Float3* out) {
    for (std::size_t face = 0; face < corners_.size() / 3; ++face) {
      // Clockwise, as the engine's fronts are.
      *out++ = positions_[corners_[3 * face]];
      *out++ = positions_[corners_[3 * face + 2]];
      *out++ = positions_[corners_[3 * face + 1]];
    }
  });
}

double GroundMesh::distanceM(const Vec3& point) const {
  const double parts[3] = {point.x, point.y, point.z};
  double square = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double apart = std::max({whole_.least[axis] - parts[axis], parts[axis] - whole_.most[axis], 0.0});
    square += apart * apart;
  }
  return std::sqrt(square);
}

}  // namespace terraport::godot
