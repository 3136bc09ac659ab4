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

/** The ground's height at (x, z), or null where there is none: there a circle keeps its last height. */
export type Heights = (x: number, z: number) => number | null;

/** A circle that is being laid on the ground. */
export interface Drape {
  /** Ask for the height of so many more points; true when all are there. */
  step(groundY: Heights, count: number): boolean;
  /** Packed x, y, z; closed: the last point is the first. Whole once `step` said so. */
  readonly points: Float32Array;
  /** Part of the points below which there is ground, 0 to 1. */
  readonly onGround: number;
}

/**
 * Lay a closed circle on the ground, a few points at a time: each is a ray through everything that is shown, and all of
 * them together are more than one frame has time for.
 *
 * @param liftM how far above the ground it lies, so that it is not buried in it.
 */
export function drapeCircle(centre: Vec3, radiusM: number, count: number, liftM: number): Drape {
  const points = new Float32Array((count + 1) * 3);
  let probed = 0;
  let groundHits = 0;
  let y = centre[1];
  return {
    points,
    get onGround() {
      return groundHits / count;
    },
    step(groundY, maxPoints) {
      const end = Math.min(count, probed + maxPoints);
      for (; probed < end; probed += 1) {
        const angle = (probed / count) * Math.PI * 2;
        const x = centre[0] + Math.sin(angle) * radiusM;
        const z = centre[2] - Math.cos(angle) * radiusM;
        const ground = groundY(x, z);
        if (ground !== null) groundHits += 1;
        y = ground ?? y;
        points.set([x, y + liftM, z], probed * 3);
      }
      if (probed < count) return false;
      points.copyWithin(count * 3, 0, 3);
      return true;
    },
  };
}

/** Points of a circle at the height of its centre, whatever the ground does: for marks too small to be draped. */
export function levelCircle(centre: Vec3, radiusM: number, count: number, liftM: number): Float32Array {
  const drape = drapeCircle(centre, radiusM, count, liftM);
  drape.step(() => null, count);
  return drape.points;
}
