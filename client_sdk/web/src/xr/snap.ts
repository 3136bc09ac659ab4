/**
 * The thumbstick: snap turns, the aim begun by pushing it forward, and the facing chosen while aiming; and the turn's vignette.
 *
 * A stick must come back near its middle before it means anything again, so one push is one turn.
 */

import { VIGNETTE_CLOSE_MS, VIGNETTE_OPEN_MS, vignetteAt } from "./curves.ts";

/** What a push of the stick means; `back` is not used. */
export type Push = "none" | "left" | "right" | "forward" | "back";

/** State of one thumbstick: a push counts once, until the stick has been let go. */
export interface Stick {
  /** The push that still holds; "none" near the middle. */
  heldPush: Push;
}

/** Beyond this it is a push, below the other it is let go; of the stick's full way. */
export const PUSH_AT = 0.7;
export const LET_GO_AT = 0.4;
/** Full way out, where a direction can be read from the stick without jitter. */
const FACING_AT = 0.85;
/** Facings are multiples of this, radians: an eighth of a turn. */
export const FACING_STEP_RAD = Math.PI / 4;

/** A stick at rest. */
export function newStick(): Stick {
  return { heldPush: "none" };
}

/** Take the stick's axes (x right, y towards the user). Returns the push that begins now, "none" in between. */
export function readStick(stick: Stick, x: number, y: number): Push {
  const tilt = Math.hypot(x, y);
  if (stick.heldPush !== "none") {
    if (tilt < LET_GO_AT) {
      stick.heldPush = "none";
    }
    return "none";
  }
  if (tilt < PUSH_AT) {
    return "none";
  }
  if (Math.abs(x) > Math.abs(y)) {
    stick.heldPush = x < 0 ? "left" : "right";
  } else {
    stick.heldPush = y < 0 ? "forward" : "back";
  }
  return stick.heldPush;
}

/**
 * The facing that the stick asks for while aiming, relative to where the head looks: forward 0, left +90 degrees.
 * Steps of an eighth of a turn. `before` is kept while the stick is not fully out, so letting it go changes nothing.
 */
export function facingOfStick(x: number, y: number, before: number): number {
  if (Math.hypot(x, y) < FACING_AT) {
    return before;
  }
  return Math.round(-Math.atan2(x, -y) / FACING_STEP_RAD) * FACING_STEP_RAD + 0;
}

/** A snap turn: the vignette closes, the turn happens in one frame, the vignette opens. */
export interface SnapTurn {
  /** Radians still to be turned, counter-clockwise. */
  angleRad: number;
  startMs: number;
  turnedMs: number;
  phase: "none" | "closing" | "opening";
}

/** No turn. */
export function newSnapTurn(): SnapTurn {
  return { angleRad: 0, startMs: 0, turnedMs: 0, phase: "none" };
}

/** Ask for a turn. While the vignette is still open it closes first; a second push adds up. */
export function askTurn(turn: SnapTurn, angleRad: number, nowMs: number): void {
  turn.angleRad += angleRad;
  if (turn.phase === "opening") {
    // Closed again from as far as it is open.
    const closed = vignetteAt(0, nowMs - turn.turnedMs);
    turn.startMs = nowMs - closed * VIGNETTE_CLOSE_MS;
    turn.phase = "closing";
  } else if (turn.phase === "none") {
    turn.startMs = nowMs;
    turn.phase = "closing";
  }
}

/** The angle to turn in this frame; 0 in nearly all. */
export function dueTurn(turn: SnapTurn, nowMs: number): number {
  if (turn.phase === "closing" && nowMs - turn.startMs >= VIGNETTE_CLOSE_MS) {
    const angleRad = turn.angleRad;
    turn.angleRad = 0;
    turn.phase = "opening";
    turn.turnedMs = nowMs;
    return angleRad;
  }
  if (turn.phase === "opening" && nowMs - turn.turnedMs >= VIGNETTE_OPEN_MS) {
    turn.phase = "none";
  }
  return 0;
}

/** How far the vignette is closed, 0 to 1. */
export function vignetteOf(turn: SnapTurn, nowMs: number): number {
  if (turn.phase === "none") {
    return 0;
  }
  return vignetteAt(nowMs - turn.startMs, turn.phase === "opening" ? nowMs - turn.turnedMs : null);
}
