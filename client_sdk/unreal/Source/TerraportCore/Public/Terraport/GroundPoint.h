#pragma once

#include <cstdint>

#include "Terraport/Types.h"

namespace terraport {

/// Where a ray met the ground that is shown.
struct GroundPoint {
  /// Metres, scene frame.
  Vec3 position;
  /// Unit, of the face's front; scene frame.
  Vec3 normal;
  /// Along the ray, in lengths of its direction.
  double at = 0.0;
  /// Segment of the face; -1 for the base.
  std::int64_t segment = -1;
};

}  // namespace terraport
