/**
 * Whether one can stand where the arc came down, and how the ground lies there.
 *
 * At full survey resolution the face that was hit may be the side of a pebble. What counts is the ground under two feet: the
 * plane through four probes around the place.
 */

import type { Vec3 } from "../core/types.ts";
import type { GroundHit, Landings } from "../three/types.ts";

/** Why a place will not do. `outside`: nothing was met, or the ground ends beside it. `steep`: nobody could stand there. */
export type Footing = "firm" | "steep" | "outside";

export interface Stand {
  footing: Footing;
  /** Unit normal of the ground, upward. */
  readonly normal: [number, number, number];
}

/** Steeper than this is no place to stand, degrees. Boots hold on 35 on rock; scree and survey noise need room. */
export const MAX_SLOPE_DEG = 50;
/** Half the distance between opposite probes, metres: about where two feet stand. */
export const PROBE_M = 0.4;
/** Probes look for ground from so far above the place: over a boulder's rise, under a branch. */
const PROBE_FROM_M = 1;

const LEAST_UP = Math.cos((MAX_SLOPE_DEG * Math.PI) / 180);
const MOST_RISE_M = 2 * PROBE_M;

/** A stand, to be filled by `judgeFooting`. */
export function newStand(): Stand {
  return { footing: "outside", normal: [0, 1, 0] };
}

/** Judge the place that was hit, into `stand`. Four casts at most. */
export function judgeFooting(stand: Stand, hit: GroundHit | null, landings: Pick<Landings, "groundAt">): void {
  const { normal } = stand;
  normal[0] = 0;
  normal[1] = 1;
  normal[2] = 0;
  if (hit === null) {
    stand.footing = "outside";
    return;
  }
  if (hit.normal[1] <= 0) {
    // The underside of something: an overhang, a branch.
    stand.footing = "steep";
    return;
  }
  const [x, y, z] = hit.position;
  const fromY = y + PROBE_FROM_M;
  const east = landings.groundAt(x + PROBE_M, z, fromY);
  const west = landings.groundAt(x - PROBE_M, z, fromY);
  const south = landings.groundAt(x, z + PROBE_M, fromY);
  const north = landings.groundAt(x, z - PROBE_M, fromY);
  if (east === null || west === null || south === null || north === null) {
    stand.footing = "outside";
    return;
  }
  const eastRise = riseOf(west.position, east.position, 0);
  const southRise = riseOf(north.position, south.position, 2);
  const length = Math.hypot(eastRise, 1, southRise);
  normal[0] = -eastRise / length;
  normal[1] = 1 / length;
  normal[2] = -southRise / length;
  const most = Math.max(
    Math.abs(east.position[1] - y),
    Math.abs(west.position[1] - y),
    Math.abs(south.position[1] - y),
    Math.abs(north.position[1] - y),
  );
  stand.footing = normal[1] < LEAST_UP || most > MOST_RISE_M ? "steep" : "firm";
}

/** Metres of rise per metre along an axis. */
function riseOf(from: Vec3, to: Vec3, axis: 0 | 2): number {
  return (to[1] - from[1]) / (to[axis] - from[axis]);
}
