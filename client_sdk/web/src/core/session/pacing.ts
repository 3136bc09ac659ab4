/**
 * How fast the client may speak: the server's message rate, kept from this side.
 *
 * PURE; time is an argument.
 */

/** The protocol averages the rate over 10 s (section 9). */
const WINDOW_S = 10;

/** Part of the allowance that is used: clocks and batching differ between the two sides. */
const MARGIN = 0.8;

/** Token bucket that stays within `perS` messages per second over 10 s. */
export class Pacer {
  readonly #perMs: number;
  readonly #capacity: number;
  #tokens: number;
  #atMs: number;

  constructor(perS: number, nowMs: number) {
    const perSUsed = perS * MARGIN;
    this.#perMs = perSUsed / 1000;
    this.#capacity = Math.max(1, perSUsed * WINDOW_S);
    this.#tokens = this.#capacity;
    this.#atMs = nowMs;
  }

  /** Book one message; milliseconds to wait before sending it, 0 for none. */
  take(nowMs: number): number {
    const passedMs = Math.max(0, nowMs - this.#atMs);
    this.#tokens = Math.min(this.#capacity, this.#tokens + passedMs * this.#perMs) - 1;
    this.#atMs = Math.max(this.#atMs, nowMs);
    return Math.max(0, -this.#tokens / this.#perMs);
  }
}
