/**
 * What aims have brought, and what of it landings have used.
 *
 * PURE.
 */

/** Counts of one session, over all its connections. */
export class AimCounts {
  /** Landings that had an aim before them. */
  landings = 0;
  /** Those of them whose plan had nothing left to load. */
  hits = 0;
  /** Payload bytes of whole segments that came for aims. */
  prefetchedBytes = 0;
  /** Those of them that the next landing kept. */
  usedBytes = 0;
  #ahead = new Map<number, number>();
  #aimed = false;

  /** Note that an aim is answered: the next landing is judged by it. */
  prefetching(): void {
    this.#aimed = true;
  }

  /** Note a whole segment that came for an aim. */
  arrived(segment: number, length: number): void {
    this.prefetchedBytes += length;
    this.#ahead.set(segment, length);
  }

  /** Judge what came ahead by the plan of the next landing. */
  planned(keep: readonly number[], loads: boolean): void {
    if (this.#aimed) {
      this.#aimed = false;
      this.landings += 1;
      if (!loads) this.hits += 1;
    }
    const ahead = this.#ahead;
    this.#ahead = new Map();
    for (const segment of keep) this.usedBytes += ahead.get(segment) ?? 0;
  }
}
