/**
 * A landing in the headset, as a machine without clock or I/O: idle, aiming, committed, blinking.
 *
 *     idle -- aim --> aiming -- release over firm ground --> committed -- presentable --> blinking --> idle
 *                        \-- cancel, or no ground --> idle
 *
 * - While committed the user stays where they are. A new aim holds the blink back: nobody is moved in the middle of a gesture.
 *   Its release supersedes the landing that waited; its cancel lets that landing go on.
 * - What is presentable past the deadline is shown by the same blink; the rest, when it has come, by a second blink that
 *   moves nobody.
 * - The swap and the move happen in the one call of `shown`, in a frame that is drawn fully black, and so is the next.
 */

import type { Vec3 } from "../core/types.ts";
import type { LandingStatus } from "../three/types.ts";
import { FADE_IN_MS, FADE_OUT_MS, fadeIn, fadeOut } from "./curves.ts";

/** Where somebody asked to land. */
export interface Target {
  readonly position: Vec3;
  /** How much the facing turns from where the head looks then, radians, counter-clockwise. */
  readonly turnRad: number;
  /** Facing in the scene, where a bookmark says it; else null. */
  readonly facingRad: number | null;
}

/** A landing that is not wholly shown. */
export interface Pending {
  readonly landing: number;
  readonly target: Target;
  /** The user was brought there: the degraded set is shown, the rest is on its way. */
  moved: boolean;
}

interface Blink {
  readonly startMs: number;
  shown: boolean;
  openMs: number | null;
}

export type TeleportPhase = "idle" | "aiming" | "committed" | "blinking";

export interface Teleport {
  /** Who is aiming (an input's key), or -1. */
  aimBy: number;
  pending: Pending | null;
  blink: Blink | null;
  /** How black the view is, 0 to 1. */
  opacity: number;
}

/** What the frame must do. `show`: swap and move now, then call `shown`. `refused`: the landing is off. */
export type TeleportStep = "none" | "show" | "refused";

/** No aim, no landing, eyes open. */
export function newTeleport(): Teleport {
  return { aimBy: -1, pending: null, blink: null, opacity: 0 };
}

/** Where it stands; a blink counts before all else. */
export function phaseOf(teleport: Teleport): TeleportPhase {
  if (teleport.blink !== null) {
    return "blinking";
  }
  if (teleport.aimBy >= 0) {
    return "aiming";
  }
  return teleport.pending === null ? "idle" : "committed";
}

/** Somebody begins to point. False where another input does already. */
export function beginAim(teleport: Teleport, by: number): boolean {
  if (teleport.aimBy >= 0) {
    return false;
  }
  teleport.aimBy = by;
  return true;
}

/** The aim ends without a landing. `by` null: whoever aims. */
export function cancelAim(teleport: Teleport, by: number | null): boolean {
  if (teleport.aimBy < 0 || (by !== null && by !== teleport.aimBy)) {
    return false;
  }
  teleport.aimBy = -1;
  return true;
}

/** The aim ends by letting go: true where `by` did aim, and the caller lands there (if there is firm ground). */
export function releaseAim(teleport: Teleport, by: number): boolean {
  return cancelAim(teleport, by);
}

/** A landing was asked for. It takes the place of any that waited. */
export function commit(teleport: Teleport, landing: number, target: Target): void {
  teleport.pending = { landing, target, moved: false };
}

/** What `advance` reads of the newest landing. */
export type StatusOf = Pick<LandingStatus, "landing" | "phase">;

/** Once a frame. */
export function advance(teleport: Teleport, nowMs: number, status: StatusOf): TeleportStep {
  const { pending } = teleport;
  if (pending !== null && status.landing === pending.landing && status.phase === "refused") {
    teleport.pending = null;
    openBlink(teleport, nowMs);
    return "refused";
  }
  if (pending?.moved === true && status.landing === pending.landing && status.phase === "shown") {
    // Somebody else swapped the rest in: nothing is left to do.
    teleport.pending = null;
  }
  if (teleport.blink === null && pending !== null && teleport.aimBy < 0 && canShow(pending, status)) {
    teleport.blink = { startMs: nowMs, shown: false, openMs: null };
  }
  return teleport.blink === null ? "none" : advanceBlink(teleport, teleport.blink, nowMs);
}

function advanceBlink(teleport: Teleport, blink: Blink, nowMs: number): TeleportStep {
  if (!blink.shown) {
    const elapsedMs = nowMs - blink.startMs;
    teleport.opacity = fadeOut(elapsedMs);
    return elapsedMs >= FADE_OUT_MS ? "show" : "none";
  }
  // The first frame after the swap may be a long one, while the driver meets new buffers: it opens only after that.
  blink.openMs ??= nowMs;
  const openMs = nowMs - blink.openMs;
  teleport.opacity = fadeIn(openMs);
  if (openMs >= FADE_IN_MS) {
    teleport.blink = null;
    teleport.opacity = 0;
  }
  return "none";
}

/** Whether there is something to show that is not shown. */
export function canShow(pending: Pending, status: StatusOf): boolean {
  if (status.landing !== pending.landing) {
    return false;
  }
  // "shown" while the user was not moved: somebody else swapped; the move is still due.
  return (
    status.phase === "presentable" ||
    (!pending.moved && (status.phase === "degraded-presentable" || status.phase === "shown"))
  );
}

/**
 * The frame has done what "show" asked. `swapped`: the set is shown and the user moved; `degraded`: only the inner part.
 * Not swapped (a newer landing came between): the blink opens again on the old place.
 */
export function shown(teleport: Teleport, swapped: boolean, degraded: boolean): void {
  if (teleport.blink !== null) {
    teleport.blink.shown = true;
    teleport.opacity = 1;
  }
  if (!swapped || teleport.pending === null) {
    return;
  }
  if (degraded) {
    teleport.pending.moved = true;
  } else {
    teleport.pending = null;
  }
}

/** Begin at black, as a session does before the first pose. */
export function beginBlack(teleport: Teleport, nowMs: number): void {
  teleport.blink = { startMs: nowMs, shown: true, openMs: null };
  teleport.opacity = 1;
}

/** Open a blink that still closes, from as black as it is. */
function openBlink(teleport: Teleport, nowMs: number): void {
  const { blink } = teleport;
  if (blink === null || blink.shown) {
    return;
  }
  // The curves mirror each other, so the same share of the way back is the same blackness.
  const closed = Math.min(1, (nowMs - blink.startMs) / FADE_OUT_MS);
  blink.shown = true;
  blink.openMs = nowMs - (1 - closed) * FADE_IN_MS;
}
