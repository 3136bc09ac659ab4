/** Whether a landing can meet the scene at all. PURE. */

import type { Bounds, Vec3 } from "../core/types.ts";

/** Metres from a place to the box around the scene, where that is beyond the radius: nothing can be there. Else null. */
export function outsideBy(position: Vec3, radiusM: number, bounds: Bounds): number | null {
  const beyond = [0, 1, 2].map((axis) =>
    Math.max(bounds[axis]! - position[axis]!, 0, position[axis]! - bounds[axis + 3]!),
  );
  const distanceM = Math.hypot(...beyond);
  return distanceM > radiusM ? distanceM : null;
}
