/**
 * Where somebody pointed a moment ago.
 *
 * Opening a pinch moves the whole hand, and the ray with it: at 20 m the ring jumps by metres in the very frame that counts.
 * So hands land where the ring was shortly before they opened.
 */

import type { Vec3 } from "../core/types.ts";

/** Frames kept: more than `BEFORE_MS` at any frame rate of a headset. */
const KEPT = 16;
/** How long before the pinch counts as open the hand has begun to move. */
export const BEFORE_MS = 90;

interface Mark {
  timeMs: number;
  firm: boolean;
  x: number;
  y: number;
  z: number;
}

export interface Trail {
  readonly marks: readonly Mark[];
  count: number;
}

/** An empty trail. */
export function newTrail(): Trail {
  return {
    marks: Array.from({ length: KEPT }, () => ({ timeMs: 0, firm: false, x: 0, y: 0, z: 0 })),
    count: 0,
  };
}

/** Forget the targets of the aim before: a release must not land where that one pointed. */
export function clearTrail(trail: Trail): void {
  trail.count = 0;
}

/** Where the ring is in this frame; null where one cannot land. */
export function noteTarget(trail: Trail, timeMs: number, position: Vec3 | null): void {
  const mark = trail.marks[trail.count % KEPT]!;
  mark.timeMs = timeMs;
  mark.firm = position !== null;
  if (position !== null) {
    mark.x = position[0];
    mark.y = position[1];
    mark.z = position[2];
  }
  trail.count += 1;
}

/** Where the ring was `beforeMs` before `nowMs` (0: in the last frame); null where one could not land. */
export function targetBefore(trail: Trail, nowMs: number, beforeMs: number): Vec3 | null {
  const kept = Math.min(trail.count, KEPT);
  for (let k = 1; k <= kept; k++) {
    const mark = trail.marks[(trail.count - k) % KEPT]!;
    if (mark.timeMs <= nowMs - beforeMs || k === kept) {
      return mark.firm ? [mark.x, mark.y, mark.z] : null;
    }
  }
  return null;
}
