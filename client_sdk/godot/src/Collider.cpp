#include "Collider.h"

#include <algorithm>

namespace terraport::godot {

namespace {

Method kBodyCreate{"PhysicsServer", "body_create"};
Method kBodySetSpace{"PhysicsServer", "body_set_space"};
Method kBodySetState{"PhysicsServer", "body_set_state"};
Method kBodySetLayer{"PhysicsServer", "body_set_collision_layer"};
Method kBodyAddShape{"PhysicsServer", "body_add_shape"};
Method kBodyRemoveShape{"PhysicsServer", "body_remove_shape"};
Method kShapeCreate{"PhysicsServer", "shape_create"};
Method kShapeSetData{"PhysicsServer", "shape_set_data"};
Method kFree{"PhysicsServer", "free_rid"};

constexpr int kStatic = 0;            // PhysicsServer.BODY_MODE_STATIC
constexpr int kStateTransform = 0;    // PhysicsServer.BODY_STATE_TRANSFORM
constexpr int kConcavePolygon = 7;    // PhysicsServer.SHAPE_CONCAVE_POLYGON

abi::Object* physics() {
  static abi::Object* const server = singleton("PhysicsServer");
  return server;
}

}  // namespace

Collider::Collider(const Variant& space, const Variant& transform, double radiusM, std::int64_t layer) : radiusM_(radiusM) {
  if (radiusM <= 0.0) return;
  body_ = kBodyCreate(physics(), kStatic);
  (void)kBodySetSpace(physics(), body_, space);
  (void)kBodySetState(physics(), body_, kStateTransform, transform);
  (void)kBodySetLayer(physics(), body_, layer);
}

Collider::~Collider() {
  if (body_.isNil()) return;
  (void)kFree(physics(), body_);
  for (const Shape& shape : shapes_) (void)kFree(physics(), shape.rid);
}

void Collider::setTransform(const Variant& transform) {
  if (!body_.isNil()) (void)kBodySetState(physics(), body_, kStateTransform, transform);
}

void Collider::setCentre(const Vec3& centre) {
  centre_ = centre;
}

void Collider::show(std::int64_t source, std::shared_ptr<const GroundMesh> ground) {
  if (!body_.isNil() && ground && !ground->isEmpty()) shown_[source] = std::move(ground);
}

void Collider::hide(std::int64_t source) {
  shown_.erase(source);
}

bool Collider::isWanted(const Shape& shape) const {
  const auto entry = shown_.find(shape.source);
  return entry != shown_.end() && entry->second == shape.ground && shape.ground->distanceM(centre_) <= radiusM_;
}

bool Collider::step() {
  if (body_.isNil()) return false;
  // 1. What is to come, the nearest first: there must be ground before the old one goes.
  const std::pair<const std::int64_t, std::shared_ptr<const GroundMesh>>* nearest = nullptr;
  double nearestM = radiusM_;
  for (const auto& entry : shown_) {
    const auto isIt = [&entry](const Shape& shape) { return shape.source == entry.first && shape.ground == entry.second; };
    const double distanceM = entry.second->distanceM(centre_);
    if (distanceM <= nearestM && std::none_of(shapes_.begin(), shapes_.end(), isIt)) {
      nearest = &entry;
      nearestM = distanceM;
    }
  }
  if (nearest != nullptr) {
    Shape shape{nearest->first, nearest->second, kShapeCreate(physics(), kConcavePolygon)};
    (void)kShapeSetData(physics(), shape.rid, shape.ground->faces());
    (void)kBodyAddShape(physics(), body_, shape.rid);
    shapes_.push_back(std::move(shape));
    return true;
  }
  // 2. Then all of what is not wanted.
  bool hasChanged = false;
  for (std::size_t at = shapes_.size(); at-- > 0;) {
    if (isWanted(shapes_[at])) continue;
    (void)kBodyRemoveShape(physics(), body_, static_cast<std::int64_t>(at));
    (void)kFree(physics(), shapes_[at].rid);
    shapes_.erase(shapes_.begin() + static_cast<std::ptrdiff_t>(at));
    hasChanged = true;
  }
  return hasChanged;
}

}  // namespace terraport::godot
