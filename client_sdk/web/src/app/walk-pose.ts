/** Standing and walking on what is shown. PURE. Angles as in orbit-pose.ts. */

import type { Vec3 } from "../core/types.ts";
import { wrapped } from "../three/orbit-pose.ts";

/** Where the feet are, and how the head looks. */
export interface WalkPose {
  /** On the ground. */
  readonly feet: Vec3;
  /** Height of the eye; follows the feet a little late, so that rough ground does not shake the picture. */
  readonly eyeY: number;
  readonly yawDeg: number;
  readonly pitchDeg: number;
}

/** What the user wants, each from -1 to 1. */
export interface WalkInput {
  readonly forward: number;
  readonly right: number;
  /** Turning and nodding by keys. */
  readonly turn: number;
  readonly nod: number;
  readonly fast: boolean;
}

/** The ground's height at (x, z): the highest not above `fromY`, else the lowest above it; null where there is none. */
export type GroundHeight = (x: number, z: number, fromY: number) => number | null;

/** Eyes of a person of 1.80 m. */
export const EYE_HEIGHT_M = 1.7;

/** A brisk walk, and a run that crosses a landing of 60 m in some seconds. */
const WALK_M_PER_S = 2.2;
const FAST_M_PER_S = 9;
const TURN_DEG_PER_S = 80;

/** What a step climbs, as a part of its length; steeper is a wall and is walked along, not up. */
const MAX_CLIMB = 2.5;
/** Climbed however short the step: as much as the base may stand above the detail's rim, where nobody must be stuck. */
const KERB_M = 1.2;

/** How fast the eye takes on the ground's height: quick enough to stay above it, slow enough not to shake. */
const SETTLE_PER_S = 14;

/** With so much free before the eyes one sees where one is. */
const CLEAR_M = 5;
/** Turns that are tried, the smallest first. */
const TURNS_DEG = [0, 45, -45, 90, -90, 135, -135, 180] as const;

/**
 * Which way somebody looks who comes down from above: as he looked, unless he would stand with his nose at a wall; then as near
 * to it as there is a view. `sightM` is how far one sees at a yaw, metres, infinite into the sky.
 */
export function openYaw(yawDeg: number, sightM: (yawDeg: number) => number): number {
  let best = { yawDeg, sightM: -1 };
  for (const turnDeg of TURNS_DEG) {
    const candidate = wrapped(yawDeg + turnDeg);
    const freeM = sightM(candidate);
    if (freeM >= CLEAR_M) return candidate;
    if (freeM > best.sightM) best = { yawDeg: candidate, sightM: freeM };
  }
  return best.yawDeg;
}

/** One frame of walking. `dtS` is bounded: after a pause the user is not thrown across the scene. */
export function walked(pose: WalkPose, input: WalkInput, dtS: number, ground: GroundHeight): WalkPose {
  const dt = Math.min(dtS, 0.1);
  const yawDeg = wrapped(pose.yawDeg + input.turn * TURN_DEG_PER_S * dt);
  const pitchDeg = clampNod(pose.pitchDeg + input.nod * TURN_DEG_PER_S * 0.6 * dt);
  const yaw = (yawDeg * Math.PI) / 180;
  // Forward and sideways together are not faster than either.
  const size = Math.max(1, Math.hypot(input.forward, input.right));
  const stepM = ((input.fast ? FAST_M_PER_S : WALK_M_PER_S) * dt) / size;
  const dx = (Math.sin(yaw) * input.forward + Math.cos(yaw) * input.right) * stepM;
  const dz = (-Math.cos(yaw) * input.forward + Math.sin(yaw) * input.right) * stepM;
  const lengthM = Math.hypot(dx, dz);
  const [x, y, z] = pose.feet;
  const climbM = Math.max(KERB_M, lengthM * MAX_CLIMB);
  for (const [nextX, nextZ] of [
    [x + dx, z + dz],
    // Along a wall rather than stuck at it.
    [x + dx, z],
    [x, z + dz],
  ] as const) {
    const groundY = ground(nextX, nextZ, y + climbM);
    // Beyond the edge of the ground nobody falls: the step is not made.
    if (groundY === null || groundY - y > climbM) continue;
    return { feet: [nextX, groundY, nextZ], eyeY: settled(pose.eyeY, groundY + EYE_HEIGHT_M, dt), yawDeg, pitchDeg };
  }
  return { ...pose, eyeY: settled(pose.eyeY, y + EYE_HEIGHT_M, dt), yawDeg, pitchDeg };
}

/** Whether the eye has not yet taken on the ground's height: another frame is wanted. */
export function isSettling(pose: WalkPose): boolean {
  return pose.eyeY !== pose.feet[1] + EYE_HEIGHT_M;
}

/** Put down at a place: on the ground there, where there is any. */
export function placed(at: Vec3, yawDeg: number, pitchDeg: number, ground: GroundHeight): WalkPose {
  const y = ground(at[0], at[2], at[1] + EYE_HEIGHT_M) ?? at[1];
  return {
    feet: [at[0], y, at[2]],
    eyeY: y + EYE_HEIGHT_M,
    yawDeg: wrapped(yawDeg),
    pitchDeg: clampNod(pitchDeg),
  };
}

/** Where the eye is. */
export function walkEye(pose: WalkPose): Vec3 {
  return [pose.feet[0], pose.eyeY, pose.feet[2]];
}

/** A head nods so far. */
export function clampNod(pitchDeg: number): number {
  return Math.min(85, Math.max(-85, pitchDeg));
}

function settled(fromY: number, toY: number, dtS: number): number {
  const remainingM = (fromY - toY) * Math.exp(-SETTLE_PER_S * dtS);
  return Math.abs(remainingM) < 0.002 ? toY : toY + remainingM;
}
