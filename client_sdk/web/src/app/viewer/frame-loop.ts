/**
 * Frames only when something changes, through `setAnimationLoop` alone, so that a headset's own frames come the same way.
 *
 * A page that draws sixty times a second for nothing empties a laptop in an hour.
 */

import type { WebGLRenderer } from "three";
import type { FrameTimes } from "../frame-times.ts";

/** What a frame says of the next. */
export type FrameResult = "again" | "rest";

/** Draws on request and rests otherwise: a still picture costs no power. */
export interface FrameLoop {
  /** Something changed: at least one more frame. */
  request(): void;
  /** Frames drawn since the start. */
  readonly count: number;
  stop(): void;
}

/** Start resting. `frame` draws; `dtS` is 0 in the first frame after a rest. */
export function createFrameLoop(
  renderer: WebGLRenderer,
  times: FrameTimes,
  frame: (timeMs: number, dtS: number, xrFrame: XRFrame | null) => FrameResult,
): FrameLoop {
  let running = false;
  let isRequested = false;
  let stopped = false;
  let lastMs = 0;
  let count = 0;

  function tick(timeMs: number, xrFrame?: XRFrame): void {
    const rested = lastMs === 0;
    isRequested = false;
    times.begin(timeMs, rested);
    const dtS = rested ? 0 : Math.max(0, timeMs - lastMs) / 1000;
    lastMs = timeMs;
    count += 1;
    const result = frame(timeMs, dtS, xrFrame ?? null);
    if (result === "rest" && !isRequested && !renderer.xr.isPresenting) {
      running = false;
      lastMs = 0;
      renderer.setAnimationLoop(null);
    }
  }

  return {
    request() {
      isRequested = true;
      if (running || stopped) return;
      running = true;
      isRequested = false;
      renderer.setAnimationLoop(tick);
    },
    get count() {
      return count;
    },
    stop() {
      stopped = true;
      renderer.setAnimationLoop(null);
    },
  };
}
