// What bodies of the engine's physics stand on: the shown ground near a place.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "Godot.h"
#include "GroundMesh.h"

namespace terraport::godot {

/// One static body whose shapes are the shown pieces of ground within a radius of the last landing. Making a shape takes about
/// a millisecond for a thousand faces, so one is made in a frame. Main thread.
class Collider {
 public:
  /// `radiusM` 0: no body at all.
  Collider(const Variant& space, const Variant& transform, double radiusM, std::int64_t layer);
  ~Collider();
  Collider(const Collider&) = delete;
  Collider& operator=(const Collider&) = delete;

  void setTransform(const Variant& transform);
  /// Where people stand from now on, scene frame.
  void setCentre(const Vec3& centre);
  /// A piece of ground is drawn from now on, or not any more. `source`: a segment, or below 0 a block of the base.
  void show(std::int64_t source, std::shared_ptr<const GroundMesh> ground);
  void hide(std::int64_t source);
  /// Make one shape, or take some away; false where all is as it is to be.
  bool step();
  std::size_t shapeCount() const { return shapes_.size(); }

 private:
  struct Shape {
    std::int64_t source;
    std::shared_ptr<const GroundMesh> ground;
    Variant rid;
  };

  bool isWanted(const Shape& shape) const;

  Variant body_;
  double radiusM_;
  Vec3 centre_;
  std::map<std::int64_t, std::shared_ptr<const GroundMesh>> shown_;
  /// In the body's own order.
  std::vector<Shape> shapes_;
};

}  // namespace terraport::godot
