/**
 * A short closing of the eyes around a swap: what the ground is made of changes while nothing is seen.
 *
 * Driven by frames, not by CSS: the swap must happen in a frame that is known to be dark.
 */

import { h } from "../dom.ts";

const CLOSE_MS = 110;
const OPEN_MS = 170;

/** Closes the picture for a moment, so that a change happens unseen. */
export interface Blink {
  readonly element: HTMLElement;
  readonly isRunning: boolean;
  /** Close, call `onDark` in the first frame that is dark, open again. Without motion: call it in the next frame. */
  start(onDark: () => void, withoutMotion: boolean): void;
  update(timeMs: number): void;
}

/** Make it, open. */
export function createBlink(): Blink {
  const element = h("div", { class: "blink", "aria-hidden": "true", hidden: true });
  let pending: (() => void) | null = null;
  let startMs: number | null = null;
  let running = false;
  let withoutMotion = false;

  return {
    element,
    get isRunning() {
      return running;
    },
    start(onDark, plain) {
      pending = onDark;
      startMs = null;
      running = true;
      withoutMotion = plain;
    },
    update(timeMs) {
      if (!running) return;
      if (withoutMotion) {
        running = false;
        pending?.();
        pending = null;
        return;
      }
      startMs ??= timeMs;
      const elapsedMs = timeMs - startMs;
      element.hidden = false;
      if (elapsedMs < CLOSE_MS) {
        element.style.opacity = String(elapsedMs / CLOSE_MS);
        return;
      }
      if (pending !== null) {
        element.style.opacity = "1";
        pending();
        pending = null;
        // The opening counts from here: a slow frame in the dark must not cut it short.
        startMs = timeMs - CLOSE_MS;
        return;
      }
      const open = Math.min(1, (elapsedMs - CLOSE_MS) / OPEN_MS);
      element.style.opacity = String(1 - open);
      if (open === 1) {
        running = false;
        element.hidden = true;
      }
    },
  };
}
