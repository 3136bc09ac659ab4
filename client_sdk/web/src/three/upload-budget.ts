/** How much of a frame uploads may take. PURE. */

import { FrameTimes } from "./frame-times.ts";

const DEFAULT_MS = 3;
const SLOW_FRAME_SHARE = 0.15;
/** With the slice in hand when it is used up, well below a long task of 50 ms. */
const MAX_MS = 30;
/** A headset draws twice in 11 to 14 ms. */
const HEADSET_MS = 1.5;
/** A page that draws only when there is something to draw rests in between: that is no slow frame. */
const REST_MS = 1000;

/** By what was set, else by the device and by how fast frames follow each other. */
export class UploadBudget {
  /** How long updates took. */
  readonly times = new FrameTimes();
  #setMs: number | null;
  #begunAtMs = Number.NEGATIVE_INFINITY;
  /** Between the last two updates; 0 after a rest. */
  #intervalMs = 0;

  constructor(setMs: number | null) {
    this.#setMs = setMs;
  }

  /** Milliseconds of one frame. */
  ms(isHeadset: boolean): number {
    if (this.#setMs !== null) return this.#setMs;
    if (isHeadset) return HEADSET_MS;
    return Math.min(Math.max(DEFAULT_MS, SLOW_FRAME_SHARE * this.#intervalMs), MAX_MS);
  }

  set(ms: number): void {
    this.#setMs = ms;
  }

  /** An update begins. */
  begin(nowMs: number): void {
    const intervalMs = nowMs - this.#begunAtMs;
    this.#intervalMs = intervalMs < REST_MS ? intervalMs : 0;
    this.#begunAtMs = nowMs;
  }

  /** It ends. */
  end(nowMs: number): void {
    this.times.add(nowMs - this.#begunAtMs);
  }
}
