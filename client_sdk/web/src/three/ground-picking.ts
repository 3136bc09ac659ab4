/** Rays against what is shown: detail, and the base faces that are not hidden. PURE. */

import type { SceneFiles, Vec3 } from "../core/types.ts";
import { FaceBoxes, rayMeetsBounds } from "./face-boxes.ts";
import type { GroundHit } from "./types.ts";

/** Something shown that a ray may meet. */
export interface Pickable {
  /** Segment id, or -1 for the base. */
  readonly segment: number;
  readonly bounds: ArrayLike<number>;
  readonly boxes: FaceBoxes;
}

/** What is shown. */
export interface ShownGround {
  readonly segments: Iterable<Pickable>;
  readonly base: Pickable | null;
  /** Bit set of the base faces that are not drawn. */
  readonly hidden: Uint8Array | undefined;
  /** How far the base is drawn behind where it is. */
  readonly pushM: number;
}

/**
 * The first point of what is shown along a ray, within `maxDistanceM`; null where there is none, or no direction.
 *
 * As in the picture, detail stands before base that lies less than the push before it.
 */
export function castGround(ground: ShownGround, origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null {
  const length = Math.hypot(...direction);
  if (!(length > 0) || !(maxDistanceM >= 0)) {
    return null;
  }
  const unit: Vec3 = [direction[0] / length, direction[1] / length, direction[2] / length];
  const first = firstAlong(ground, origin, unit, maxDistanceM);
  return first ? describe(first, origin, unit) : null;
}

function firstAlong(ground: ShownGround, origin: Vec3, unit: Vec3, maxDistanceM: number): Meeting | null {
  const base = ground.base ? meet(ground.base, origin, unit, maxDistanceM, ground.hidden) : null;
  // The base is drawn pushed back: detail that lies so far behind it is seen before it all the same.
  let nearestM = base ? Math.min(base.t + ground.pushM, maxDistanceM) : maxDistanceM;
  let detail: Meeting | null = null;
  for (const segment of ground.segments) {
    const hit = meet(segment, origin, unit, nearestM, undefined);
    if (hit) {
      detail = hit;
      nearestM = hit.t;
    }
  }
  return detail ?? base;
}

/** The base of a scene, as something that a ray may meet. */
export function pickableBase({ base }: SceneFiles): Pickable {
  return { segment: -1, bounds: base.bounds, boxes: new FaceBoxes(base) };
}

const DOWN: Vec3 = [0, -1, 0];
const UP: Vec3 = [0, 1, 0];
/** Ceilings that are looked through; more of them lie over each other in no quarry. */
const MAX_CEILINGS = 16;
/** So far behind a ceiling the ray goes on. */
const BEHIND_M = 0.001;

/**
 * Ground on the vertical through (x, z): the highest not above `fromY`, else the lowest above it. The normal points up.
 *
 * A face that faces down is the underside of an overhang: whoever took it for ground stood in the rock above it. It counts
 * where there is nothing else, as in a survey whose normals came out the wrong way round.
 */
export function groundOnVertical(ground: ShownGround, x: number, z: number, fromY: number): GroundHit | null {
  const origin: Vec3 = [x, fromY, z];
  const hit =
    facingUp(ground, origin, DOWN) ??
    facingUp(ground, origin, UP) ??
    castGround(ground, origin, DOWN, Number.MAX_VALUE) ??
    castGround(ground, origin, UP, Number.MAX_VALUE);
  if (!hit || hit.normal[1] >= 0) {
    return hit;
  }
  const [nx, ny, nz] = hit.normal;
  return { ...hit, normal: [0 - nx, 0 - ny, 0 - nz] };
}

/** The first face along a vertical ray that faces up. */
function facingUp(ground: ShownGround, origin: Vec3, unit: Vec3): GroundHit | null {
  let travelledM = 0;
  for (let ceilings = 0; ceilings <= MAX_CEILINGS; ceilings += 1) {
    const from: Vec3 = [origin[0], origin[1] + travelledM * unit[1], origin[2]];
    const first = firstAlong(ground, from, unit, Number.MAX_VALUE);
    if (first === null) return null;
    if (first.target.boxes.normalOf(first.face)[1] > 0)
      return describe({ ...first, t: travelledM + first.t }, origin, unit);
    travelledM += first.t + BEHIND_M;
  }
  return null;
}

interface Meeting {
  readonly target: Pickable;
  readonly t: number;
  readonly face: number;
}

function meet(
  target: Pickable,
  origin: Vec3,
  unit: Vec3,
  maxT: number,
  hidden: Uint8Array | undefined,
): Meeting | null {
  if (!rayMeetsBounds(origin, unit, maxT, target.bounds)) {
    return null;
  }
  const hit = target.boxes.cast(origin, unit, maxT, hidden);
  return hit ? { target, t: hit.t, face: hit.face } : null;
}

function describe({ target, t, face }: Meeting, origin: Vec3, unit: Vec3): GroundHit {
  const [nx, ny, nz] = target.boxes.normalOf(face);
  const sign = nx * unit[0] + ny * unit[1] + nz * unit[2] > 0 ? -1 : 1;
  return {
    position: [origin[0] + t * unit[0], origin[1] + t * unit[1], origin[2] + t * unit[2]],
    normal: [sign * nx + 0, sign * ny + 0, sign * nz + 0], // No -0.
    isOuter: sign > 0,
    distanceM: t,
    segment: target.segment,
    region: target.boxes.regionOf(face),
  };
}
