/**
 * The client's memory of segments: a byte-bounded LRU with pins.
 *
 * What is pinned (the visible segments, and those of a plan on its way) is never evicted; everything else goes, least
 * recently used first, as soon as the bound is exceeded. Pins may exceed the bound: a landing must be held whole, and
 * its size is bounded by the budgets of the landing instead.
 *
 * PURE. "Recently" is counted in accesses, not in time.
 */

import type { SegmentFacts } from "../types.ts";

/** A payload with what is known of it. */
export interface CachedSegment {
  readonly facts: SegmentFacts;
  readonly payload: Uint8Array<ArrayBuffer>;
}

/** Byte-bounded LRU of payloads with pins; owned by one session. */
export class SegmentCache {
  readonly maxBytes: number;
  // A Map keeps its insertion order: the first entry is the least recently used.
  readonly #entries = new Map<number, CachedSegment>();
  #pinned: ReadonlySet<number> = new Set();
  #bytes = 0;

  /** `maxBytes` bounds the payload bytes beside what is pinned; 0 keeps pinned segments only. */
  constructor(maxBytes: number) {
    if (!(maxBytes >= 0)) throw new RangeError(`cache bound is ${maxBytes} bytes, expected 0 or more`);
    this.maxBytes = maxBytes;
  }

  /** Payload bytes held now, pinned ones included. */
  get bytes(): number {
    return this.#bytes;
  }

  get size(): number {
    return this.#entries.size;
  }

  has(segment: number): boolean {
    return this.#entries.has(segment);
  }

  /** Ids held, least recently used first. */
  ids(): number[] {
    return [...this.#entries.keys()];
  }

  /** The entry, from now on the most recently used. */
  get(segment: number): CachedSegment | undefined {
    const entry = this.#entries.get(segment);
    if (entry !== undefined) {
      this.#entries.delete(segment);
      this.#entries.set(segment, entry);
    }
    return entry;
  }

  /** The entry; its age does not change. */
  peek(segment: number): CachedSegment | undefined {
    return this.#entries.get(segment);
  }

  /**
   * Add (or replace) a payload as the most recently used; evicts nothing.
   *
   * Eviction is a step of its own, {@link trim}: between a `land` and its `plan` nothing may be evicted, because the
   * plan may count on it.
   */
  put(entry: CachedSegment): void {
    this.discard(entry.facts.segment);
    this.#entries.set(entry.facts.segment, entry);
    this.#bytes += entry.payload.byteLength;
  }

  /** Drop one entry, pinned or not; whether it was held. */
  discard(segment: number): boolean {
    const entry = this.#entries.get(segment);
    if (entry === undefined) return false;
    this.#entries.delete(segment);
    this.#bytes -= entry.payload.byteLength;
    return true;
  }

  /** Make exactly these ids the pinned ones. Evicts nothing; call {@link trim} for that. */
  pin(segments: Iterable<number>): void {
    this.#pinned = new Set(segments);
  }

  /** Evict unpinned entries, least recently used first, until the bound holds or none is left; in that order. */
  trim(): SegmentFacts[] {
    const evicted: SegmentFacts[] = [];
    if (this.#bytes <= this.maxBytes) return evicted;
    for (const [segment, entry] of this.#entries) {
      if (this.#bytes <= this.maxBytes) break;
      if (this.#pinned.has(segment)) continue;
      this.discard(segment);
      evicted.push(entry.facts);
    }
    return evicted;
  }
}
