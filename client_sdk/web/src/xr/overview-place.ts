/** Where the model of the scene stands before somebody, and what of the ground a ray at the model means. No three.js. */

import type { Bounds, Vec3 } from "../core/types.ts";
import type { MiniaturePose } from "../three/types.ts";

/** The model's longer side, metres: both ends are reached by turning the wrist, and a scene of 1.5 km is 1 : 1700. */
const SIDE_M = 0.9;
/** No higher than this, whatever its plan is: a tower would stand before the eyes. */
const HEIGHT_M = 0.45;
/** Ahead of the eyes and below them: where a table is. */
const AHEAD_M = 0.85;
const BELOW_M = 0.6;

/** The model of a scene before somebody's eyes, at a table's height. Scenes without extent have one of a metre. */
export function miniatureBefore(bounds: Bounds, eye: Vec3, facingRad: number): MiniaturePose {
  const [x0, y0, z0, x1, y1, z1] = bounds;
  const sideM = Math.max(x1 - x0, z1 - z0, 1);
  const scale = Math.min(SIDE_M / sideM, HEIGHT_M / Math.max(y1 - y0, 1));
  return {
    middle: [(x0 + x1) / 2, y0, (z0 + z1) / 2],
    at: [eye[0] - Math.sin(facingRad) * AHEAD_M, eye[1] - BELOW_M, eye[2] - Math.cos(facingRad) * AHEAD_M],
    scale,
  };
}

/** Where a place of the ground is on the model. */
export function onModel({ middle, at, scale }: MiniaturePose, place: Vec3): Vec3 {
  return [
    at[0] + scale * (place[0] - middle[0]),
    at[1] + scale * (place[1] - middle[1]),
    at[2] + scale * (place[2] - middle[2]),
  ];
}

/** Where on the ground a ray begins that meets it where one from `origin` meets the model; its direction is the same. */
export function rayOverGround({ middle, at, scale }: MiniaturePose, origin: Vec3): Vec3 {
  return [
    middle[0] + (origin[0] - at[0]) / scale,
    middle[1] + (origin[1] - at[1]) / scale,
    middle[2] + (origin[2] - at[2]) / scale,
  ];
}
