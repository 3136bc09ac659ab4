/** The arc from the user to where he points, and the ring around it. PURE. */

import type { Vec3 } from "../core/types.ts";

/** How far the arc rises above the straight line, as a part of its length; and at most so many metres. */
const RISE = 0.18;
const MAX_RISE_M = 40;

/**
 * Points along a parabola from `from` to `to`, both included, packed x, y, z.
 *
 * It starts a little below the eye (`dropM`): a curve that starts in the eye is seen end-on, as a point.
 */
export function arcPoints(from: Vec3, to: Vec3, count: number, dropM = 0.6): Float32Array {
  const points = new Float32Array(count * 3);
  const startY = from[1] - dropM;
  const length = Math.hypot(to[0] - from[0], to[1] - startY, to[2] - from[2]);
  const riseM = Math.min(MAX_RISE_M, length * RISE);
  for (let index = 0; index < count; index += 1) {
    const t = index / (count - 1);
    points[index * 3] = from[0] + (to[0] - from[0]) * t;
    points[index * 3 + 1] = startY + (to[1] - startY) * t + 4 * riseM * t * (1 - t);
    points[index * 3 + 2] = from[2] + (to[2] - from[2]) * t;
  }
  return points;
}

/**
 * A closed circle draped over the ground, packed x, y, z.
 *
 * @param groundY height of the ground at (x, z), or null where there is none: there the circle keeps its last height.
 * @param liftM how far above the ground it lies, so that it is not buried in it.
 */
export function drapedCircle(
  centre: Vec3,
  radiusM: number,
  count: number,
  groundY: (x: number, z: number) => number | null,
  liftM: number,
): Float32Array {
  const points = new Float32Array((count + 1) * 3);
  let y = centre[1];
  for (let index = 0; index <= count; index += 1) {
    const angle = ((index % count) / count) * Math.PI * 2;
    const x = centre[0] + Math.sin(angle) * radiusM;
    const z = centre[2] - Math.cos(angle) * radiusM;
    y = groundY(x, z) ?? y;
    points.set([x, y + liftM, z], index * 3);
  }
  return points;
}
