/**
 * Whether one can stand where an arc came down or a click met the ground, and how the ground lies there. PURE.
 *
 * At full survey resolution the face that was hit may be the side of a pebble. What counts is the ground under two feet: the
 * plane through four probes around the place.
 */

import type { Vec3 } from "../core/types.ts";
import type { GroundHit, Landings } from "./types.ts";

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

/** Somebody of 1.80 m with a helmet. */
export const HEADROOM_M = 1.9;
/** What stands over the feet by less is no ceiling: the coarser base over the detail's rim, a pebble. */
const KNEE_M = 0.4;
/** Another place to stand is looked for on rings about one that will not do, metres. */
const RINGS_M = [0.5, 1, 1.5, 2.5, 4, 6, 9] as const;
const PLACES_OF_RING = 8;
/** One that is farther away, up or down a cliff, is not what was pointed at. */
export const MAX_BESIDE_M = 12;
/** A search from an underside begins so far below it. */
const BELOW_M = 0.05;

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
  // The ground ends beside it: nobody is put on an edge.
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
  const riseM = Math.max(
    Math.abs(east.position[1] - y),
    Math.abs(west.position[1] - y),
    Math.abs(south.position[1] - y),
    Math.abs(north.position[1] - y),
  );
  stand.footing = normal[1] < LEAST_UP || riseM > MOST_RISE_M ? "steep" : "firm";
}

/** Where feet are put instead of a place in a wall or under a ceiling: what is asked of the ground. */
export type Footed = Pick<Landings, "cast" | "groundAt">;

/**
 * The firm place with room above it that is nearest to what was hit: that place itself, the foot of a wall or its top, the
 * floor below an underside. Null where there is none within `MAX_BESIDE_M`. Some hundred casts: for a click, not a frame.
 */
export function standNear(hit: Pick<GroundHit, "position" | "normal">, landings: Footed): Vec3 | null {
  const [x, y, z] = hit.position;
  const [nx, ny, nz] = hit.normal;
  const isUnderside = ny < 0;
  // Above an underside is rock; above anything else perhaps a boulder's rise, and the top of the wall that was hit.
  const levels = isUnderside ? [y - BELOW_M] : [y + PROBE_FROM_M, y + MAX_BESIDE_M];
  let nearest: Vec3 | null = null;
  let nearestM = MAX_BESIDE_M;
  const look = (atX: number, atZ: number): void => {
    for (const fromY of levels) {
      const ground = landings.groundAt(atX, atZ, fromY);
      if (ground === null) continue;
      const [, groundY] = ground.position;
      const besideM = Math.hypot(atX - x, groundY - y, atZ - z);
      // What lies over an underside is not where one looked from.
      if (besideM >= nearestM || (isUnderside && groundY > y) || !isFirm(ground, landings)) continue;
      nearest = ground.position;
      nearestM = besideM;
    }
  };
  look(x, z);
  if (isUnderside && nearest !== null) return nearest;
  // The side that was seen comes first, where two are equally near.
  const outward = Math.atan2(nz, nx);
  for (const ringM of RINGS_M) {
    if (ringM >= nearestM) break;
    for (let turn = 0; turn < PLACES_OF_RING; turn += 1) {
      const angle = outward + (turn * 2 * Math.PI) / PLACES_OF_RING;
      look(x + ringM * Math.cos(angle), z + ringM * Math.sin(angle));
    }
  }
  return nearest;
}

/** Rays that look for the rock around an eye reach so far, metres. */
const SIGHT_M = 1e6;

/**
 * Whether an eye is inside the rock, or below the ground: what it sees above it, or below it, is seen from inside, or there is
 * no ground below it.
 */
export function isBuried(eye: Vec3, landings: Pick<Landings, "cast">): boolean {
  const above = landings.cast(eye, [0, 1, 0], SIGHT_M);
  const below = landings.cast(eye, [0, -1, 0], SIGHT_M);
  return above?.isOuter === false || below === null || !below.isOuter;
}

function isFirm(ground: GroundHit, landings: Footed): boolean {
  const stand = newStand();
  judgeFooting(stand, ground, landings);
  if (stand.footing !== "firm") return false;
  const [x, y, z] = ground.position;
  const above = landings.cast([x, y + KNEE_M, z], [0, 1, 0], HEADROOM_M - KNEE_M);
  // What is met from inside is ground that faces up: the base over the detail.
  return !above?.isOuter;
}

/** Metres of rise per metre along an axis. */
function riseOf(from: Vec3, to: Vec3, axis: 0 | 2): number {
  return (to[1] - from[1]) / (to[axis] - from[axis]);
}
