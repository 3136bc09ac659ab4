/** Opening the menu without buttons: the left palm held before the eyes for a moment, as one looks at one's hand. */

import type { Vec3 } from "../core/types.ts";

/** How long the palm must be held so. Shorter, and every gesture in conversation opens the menu. */
export const HOLD_MS = 700;
/** Within this of straight at the eyes; further than the second it has been turned away. */
const FACING_COS = 0.8;
const AWAY_COS = 0.5;
/** A hand hanging down turns its palm wherever it likes; one that is looked at is near the eyes. */
const NEAR_M = 0.6;

export interface PalmHold {
  sinceMs: number | null;
  /** It has opened the menu and must be turned away before it does again. */
  spent: boolean;
}

/** No palm seen. */
export function newPalmHold(): PalmHold {
  return { sinceMs: null, spent: false };
}

/**
 * Cosine between the palm's normal and the way to the eyes, of the wrist's 4 x 4 matrix (column-major, WebXR: +Y out of the
 * hand's back); -1 where the hand is not near.
 */
export function palmTowards(wrist: ArrayLike<number>, eye: Vec3): number {
  const x = eye[0] - wrist[12]!;
  const y = eye[1] - wrist[13]!;
  const z = eye[2] - wrist[14]!;
  const awayM = Math.hypot(x, y, z);
  if (awayM > NEAR_M || awayM === 0) {
    return -1;
  }
  return -(wrist[4]! * x + wrist[5]! * y + wrist[6]! * z) / awayM;
}

/** True in the one frame in which the hold is long enough. */
export function holdPalm(hold: PalmHold, towards: number, nowMs: number): boolean {
  if (towards < AWAY_COS) {
    hold.sinceMs = null;
    hold.spent = false;
    return false;
  }
  if (towards < FACING_COS || hold.spent) {
    return false;
  }
  hold.sinceMs ??= nowMs;
  if (nowMs - hold.sinceMs < HOLD_MS) {
    return false;
  }
  hold.spent = true;
  return true;
}
