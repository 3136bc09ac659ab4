/** In-memory cache of payloads by key: bounded in bytes, least recently used first. PURE. */

import type { Bounds } from "../types.ts";
import type { SegmentKey } from "../wire/kinds.ts";

/** A whole payload. */
export interface CachedSegment {
  readonly key: SegmentKey;
  readonly payload: Uint8Array<ArrayBuffer>;
  /** Box of its positions, metres; null until its checksum was checked. */
  readonly bounds: Bounds | null;
}

/** Payloads of one session. "Recently" is counted in accesses, not in time. */
export class SegmentCache {
  readonly #maxBytes: number;
  /** A Map keeps its insertion order: the first entry is the least recently used. */
  readonly #entries = new Map<SegmentKey, CachedSegment>();
  #bytes = 0;

  /** @param maxBytes - maximum payload bytes in addition to what {@link trim} must keep. */
  constructor(maxBytes: number) {
    if (!(maxBytes >= 0)) throw new RangeError(`got a cache of ${maxBytes} bytes, expected 0 or more`);
    this.#maxBytes = maxBytes;
  }

  get bytes(): number {
    return this.#bytes;
  }

  get size(): number {
    return this.#entries.size;
  }

  /** All entries, least recently used first. */
  entries(): Iterable<CachedSegment> {
    return this.#entries.values();
  }

  /** Return an entry without changing its age. */
  peek(key: SegmentKey): CachedSegment | undefined {
    return this.#entries.get(key);
  }

  /** Return an entry and make it the most recently used. */
  get(key: SegmentKey): CachedSegment | undefined {
    const entry = this.#entries.get(key);
    if (entry !== undefined) {
      this.#entries.delete(key);
      this.#entries.set(key, entry);
    }
    return entry;
  }

  /** Add or replace an entry as the most recently used; evicts nothing. */
  put(entry: CachedSegment): void {
    this.delete(entry.key);
    this.#entries.set(entry.key, entry);
    this.#bytes += entry.payload.byteLength;
  }

  delete(key: SegmentKey): void {
    const entry = this.#entries.get(key);
    if (entry === undefined) return;
    this.#entries.delete(key);
    this.#bytes -= entry.payload.byteLength;
  }

  /** Evict what is not in the set that `needed` returns, until the bound holds or nothing else is left. */
  trim(needed: () => ReadonlySet<SegmentKey>): void {
    if (this.#bytes <= this.#maxBytes) return;
    const keep = needed();
    for (const key of [...this.#entries.keys()]) {
      if (this.#bytes <= this.#maxBytes) return;
      if (!keep.has(key)) this.delete(key);
    }
  }
}
