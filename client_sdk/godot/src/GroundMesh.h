// A mesh that rays are cast against: what is drawn, without colliders.
#pragma once

#include <cstdint>
#include <vector>

#include "Godot.h"
#include "Terraport/Types.h"

namespace terraport::godot {

/// Where a ray met a mesh, scene frame.
struct GroundPoint {
  /// Along the ray, in lengths of its direction.
  double at = 0.0;
  /// Unit, by the front of the face.
  Vec3 normal;
};

/// Rays against one mesh, in the scene frame. Boxes over 64 consecutive faces keep a ray to few of them: faces stand in the
/// vertex cache's order, so neighbours in the list are neighbours on the ground.
class GroundMesh {
 public:
  GroundMesh() = default;
  /// `corners`: three a face, counter-clockwise from outside, below the number of positions. O(faces).
  GroundMesh(std::vector<Float3> positions, std::vector<std::uint32_t> corners);

  /// First point at 0 < at <= maxAt, whichever way the face looks; false where there is none.
  bool cast(const Vec3& origin, const Vec3& direction, double maxAt, GroundPoint& point) const;

  /// Three corners a face, for a collision shape.
  Variant faces() const;

  bool isEmpty() const { return corners_.empty(); }
  /// Distance from a point to the box around everything, metres.
  double distanceM(const Vec3& point) const;

 private:
  struct Bounds {
    double least[3];
    double most[3];
    bool isEntered(const Vec3& origin, const Vec3& direction, double maxAt) const;
  };

  Bounds boundsOf(std::size_t firstFace, std::size_t endFace) const;

  std::vector<Float3> positions_;
  std::vector<std::uint32_t> corners_;
  Bounds whole_ = {};
  std::vector<Bounds> boxes_;
};

}  // namespace terraport::godot
