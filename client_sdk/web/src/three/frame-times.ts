/** Longest and median of the last frames' times. PURE. */

const FRAMES = 240;

/** The newest times in a ring: noting one takes no memory. */
export class FrameTimes {
  readonly #ring = new Float64Array(FRAMES);
  #count = 0;

  add(ms: number): void {
    this.#ring[this.#count % FRAMES] = ms;
    this.#count += 1;
  }

  get maxMs(): number {
    return this.#sorted().at(-1) ?? 0;
  }

  get medianMs(): number {
    const sorted = this.#sorted();
    return sorted.at(Math.floor(sorted.length / 2)) ?? 0;
  }

  #sorted(): Float64Array {
    return this.#ring.slice(0, Math.min(this.#count, FRAMES)).sort();
  }
}
