/**
 * How much is between a payload and the GPU: segments being decoded, and meshes waiting for their upload.
 *
 * PURE.
 */

/** Bounds of what is in flight. */
export interface InFlightLimits {
  /** Segments that are being decoded, or decoded and not yet uploaded, at a time. */
  readonly maxInFlight: number;
  /** GPU bytes of those, as far as can be told before they are decoded: bounds the memory beside the GPU's. */
  readonly maxInFlightBytes: number;
}

/** GPU bytes that a segment is taken to have until some were decoded: between vertex colours and a large texture. */
const FIRST_GUESS_BYTES = 6 * 1024 * 1024;
/** How fast the guess follows what came. */
const GUESS_SHARE = 0.25;

/** Counters; there is always room for one. */
export class InFlight {
  readonly #limits: InFlightLimits;
  #decoding = 0;
  #waiting = 0;
  #waitingBytes = 0;
  #guessBytes = FIRST_GUESS_BYTES;

  constructor(limits: InFlightLimits) {
    this.#limits = limits;
  }

  get count(): number {
    return this.#decoding + this.#waiting;
  }

  get hasRoom(): boolean {
    const bytes = this.#waitingBytes + (this.#decoding + 1) * this.#guessBytes;
    return this.count === 0 || (this.count < this.#limits.maxInFlight && bytes <= this.#limits.maxInFlightBytes);
  }

  /** A segment was asked for. */
  ask(): void {
    this.#decoding += 1;
  }

  /** It came, or not; it is not kept. */
  dismiss(): void {
    this.#decoding -= 1;
  }

  /** It came, and waits. */
  wait(bytes: number): void {
    this.#decoding -= 1;
    this.#waiting += 1;
    this.#waitingBytes += bytes;
    this.#guessBytes += GUESS_SHARE * (bytes - this.#guessBytes);
  }

  /** It waits no longer. */
  leave(bytes: number): void {
    this.#waiting -= 1;
    this.#waitingBytes -= bytes;
  }

  /** Nothing that was asked for will be taken any more. */
  clear(): void {
    this.#decoding = 0;
    this.#waiting = 0;
    this.#waitingBytes = 0;
  }
}
