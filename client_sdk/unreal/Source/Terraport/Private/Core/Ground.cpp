#include "Core/Ground.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace terraport {
namespace {

constexpr std::size_t kBoxFaces = 64;
/// Farther than any scene, metres.
constexpr double kFarM = 1e8;

bool isHidden(const Bytes* hidden, std::size_t face) {
  return hidden != nullptr && face / 8 < hidden->size() && (((*hidden)[face / 8] >> (face % 8)) & 1) != 0;
}

Vec3 minus(const Vec3& a, const Vec3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

double dot(const Vec3& a, const Vec3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

}  // namespace

void GroundMesh::Bounds::grow(const float* position) {
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = std::min(low[axis], position[axis]);
    high[axis] = std::max(high[axis], position[axis]);
  }
}

bool GroundMesh::Bounds::meetsCube(const Vec3& centre, double halfM) const {
  const double middle[3] = {centre.x, centre.y, centre.z};
  for (int axis = 0; axis < 3; ++axis) {
    if (low[axis] > middle[axis] + halfM || high[axis] < middle[axis] - halfM) return false;
  }
  return true;
}

/// The slabs of the box's three axes (Kay and Kajiya, 1986).
bool GroundMesh::Bounds::isEntered(const Vec3& origin, const Vec3& direction, double mostAt) const {
  const double from[3] = {origin.x, origin.y, origin.z};
  const double along[3] = {direction.x, direction.y, direction.z};
  double enter = 0.0;
  double leave = mostAt;
  for (int axis = 0; axis < 3; ++axis) {
    // A little wider than the box: the face's own test has a slack, too.
    const double least = low[axis] - 1e-6;
    const double most = high[axis] + 1e-6;
    if (along[axis] == 0.0) {
      if (from[axis] < least || from[axis] > most) return false;
      continue;
    }
    const double first = (least - from[axis]) / along[axis];
    const double second = (most - from[axis]) / along[axis];
    enter = std::max(enter, std::min(first, second));
    leave = std::min(leave, std::max(first, second));
  }
  return enter <= leave;
}

GroundMesh::Bounds GroundMesh::nothing() {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  return {{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
}

GroundMesh::GroundMesh(const SegmentMesh& mesh) : positions_(mesh.positions), faceCount_(mesh.faceCount), whole_(nothing()) {
  const std::size_t corners = mesh.indices.size();
  if (mesh.vertexCount <= 65536) {
    shortIndices_.resize(corners);
    std::transform(mesh.indices.data(), mesh.indices.data() + corners, shortIndices_.begin(),
        [](std::uint32_t index) { return static_cast<std::uint16_t>(index); });
  } else {
    longIndices_.assign(mesh.indices.data(), mesh.indices.data() + corners);
  }
  boxes_.reserve((faceCount() + kBoxFaces - 1) / kBoxFaces);
  for (std::size_t first = 0; first < corners; first += 3 * kBoxFaces) {
    Bounds box = nothing();
    for (std::size_t at = first; at < std::min(first + 3 * kBoxFaces, corners); ++at) box.grow(positionOf(at));
    whole_.grow(box.low);
    whole_.grow(box.high);
    boxes_.push_back(box);
  }
}

bool GroundMesh::cast(const Vec3& origin, const Vec3& direction, const Bytes* hidden, GroundPoint& nearest) const {
  bool isMet = false;
  if (boxes_.empty() || !whole_.isEntered(origin, direction, nearest.at)) return false;
  for (std::size_t box = 0; box < boxes_.size(); ++box) {
    if (!boxes_[box].isEntered(origin, direction, nearest.at)) continue;
    const std::size_t end = std::min<std::size_t>((box + 1) * kBoxFaces, faceCount());
    for (std::size_t face = box * kBoxFaces; face < end; ++face) {
      if (!isHidden(hidden, face) && meets(face, origin, direction, nearest)) isMet = true;
    }
  }
  return isMet;
}

bool GroundMesh::gather(
    const Vec3& centre, double halfM, const Bytes* hidden, std::size_t mostNumbers, std::vector<float>& corners) const {
  if (boxes_.empty() || !whole_.meetsCube(centre, halfM)) return true;
  for (std::size_t box = 0; box < boxes_.size(); ++box) {
    if (!boxes_[box].meetsCube(centre, halfM)) continue;
    const std::size_t end = std::min<std::size_t>((box + 1) * kBoxFaces, faceCount());
    for (std::size_t face = box * kBoxFaces; face < end; ++face) {
      Bounds bounds = nothing();
      for (std::size_t corner = 0; corner < 3; ++corner) bounds.grow(positionOf(3 * face + corner));
      if (isHidden(hidden, face) || !bounds.meetsCube(centre, halfM)) continue;
      if (corners.size() + 9 > mostNumbers) return false;
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const float* position = positionOf(3 * face + corner);
        corners.insert(corners.end(), position, position + 3);
      }
    }
  }
  return true;
}

/// Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997. In double: neighbours share their edge, and a
/// ray through it meets one of them at least.
bool GroundMesh::meets(std::size_t face, const Vec3& origin, const Vec3& direction, GroundPoint& nearest) const {
  const Vec3 a = corner(3 * face);
  const Vec3 u = minus(corner(3 * face + 1), a);
  const Vec3 v = minus(corner(3 * face + 2), a);
  const Vec3 p = cross(direction, v);
  const double determinant = dot(u, p);
  if (determinant == 0.0) return false;
  const Vec3 t = minus(origin, a);
  const double beta = dot(t, p) / determinant;
  const Vec3 q = cross(t, u);
  const double gamma = dot(direction, q) / determinant;
  const double at = dot(v, q) / determinant;
  constexpr double kSlack = 1e-9;
  if (!(beta >= -kSlack && gamma >= -kSlack && beta + gamma <= 1.0 + kSlack && at >= 0.0 && at <= nearest.at)) return false;
  const Vec3 front = cross(u, v);
  const double length = std::sqrt(dot(front, front));
  nearest.at = at;
  nearest.position = {origin.x + at * direction.x, origin.y + at * direction.y, origin.z + at * direction.z};
  nearest.normal = {front.x / length, front.y / length, front.z / length};
  return true;
}

Vec3 GroundMesh::corner(std::size_t at) const {
  const float* position = positionOf(at);
  return {double{position[0]}, double{position[1]}, double{position[2]}};
}

void ShownGround::set(SharedGround base, Bytes hidden, std::map<Key, Piece> pieces) {
  base_ = std::move(base);
  hidden_ = std::move(hidden);
  pieces_ = std::move(pieces);
  ++changes_;
}

bool ShownGround::cast(const Vec3& origin, const Vec3& direction, double mostAt, GroundPoint& point) const {
  point = GroundPoint();
  point.at = mostAt;
  bool isMet = base_ && base_->cast(origin, direction, &hidden_, point);
  for (const auto& [key, piece] : pieces_) {
    (void)key;
    if (piece.mesh && piece.mesh->cast(origin, direction, nullptr, point)) {
      point.segment = piece.segment;
      isMet = true;
    }
  }
  return isMet;
}

bool ShownGround::groundAt(const Vec3& position, GroundPoint& point) const {
  return cast(position, {0.0, -1.0, 0.0}, kFarM, point) || cast(position, {0.0, 1.0, 0.0}, kFarM, point);
}

double ShownGround::gather(const Vec3& centre, double halfM, std::size_t mostFaces, std::vector<float>& corners) const {
  constexpr int kMaxHalvings = 4;
  for (int halving = 0; halving <= kMaxHalvings; ++halving, halfM /= 2) {
    corners.clear();
    bool isWhole = !base_ || base_->gather(centre, halfM, &hidden_, 9 * mostFaces, corners);
    for (const auto& [key, piece] : pieces_) {
      (void)key;
      isWhole = isWhole && (!piece.mesh || piece.mesh->gather(centre, halfM, nullptr, 9 * mostFaces, corners));
    }
    if (isWhole) return halfM;
  }
  corners.clear();
  return 0.0;
}

}  // namespace terraport
