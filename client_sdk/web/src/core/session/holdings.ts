/**
 * What the client holds, and what the server must be told of it.
 *
 * A segment that is not held any more must be named in an `evict` before the next `land` or `aim` (wire protocol, 6.7):
 * the server counts on what it once sent.
 *
 * PURE.
 */

import type { SegmentFacts } from "../types.ts";
import type { HeldRow } from "../wire/kinds.ts";
import type { ClientMessage } from "../wire/messages.generated.ts";
import { LIMITS } from "../wire/messages.generated.ts";
import type { CachedSegment, SegmentCache } from "./cache.ts";

/** The cache, and the evictions that the server does not know yet. */
export class Holdings {
  readonly #cache: SegmentCache;
  /** Dropped here, and the server not told yet. */
  readonly #unreportedDrops = new Map<number, SegmentFacts>();

  constructor(cache: SegmentCache) {
    this.#cache = cache;
  }

  get cacheBytes(): number {
    return this.#cache.bytes;
  }

  get count(): number {
    return this.#cache.size;
  }

  has(segment: number): boolean {
    return this.#cache.has(segment);
  }

  /** Return it as the most recently used. */
  recall(segment: number): CachedSegment | undefined {
    return this.#cache.get(segment);
  }

  /** Return it without changing its age. */
  peek(segment: number): CachedSegment | undefined {
    return this.#cache.peek(segment);
  }

  /** Facts of what is held, or was until the server is told. */
  factsOf(segment: number): SegmentFacts | undefined {
    return this.#cache.peek(segment)?.facts ?? this.#unreportedDrops.get(segment);
  }

  put(entry: CachedSegment): void {
    this.#unreportedDrops.delete(entry.facts.segment);
    this.#cache.put(entry);
  }

  /** Make exactly these the ones that must not be evicted. */
  pin(segments: Iterable<number>): void {
    this.#cache.pin(segments);
  }

  /** Evict down to the bound; returns the ids that went. */
  trim(): number[] {
    return this.#cache.trim().map((facts) => {
      this.#unreportedDrops.set(facts.segment, facts);
      return facts.segment;
    });
  }

  /** Drop segments that the server knows to be gone: dropped by it, or rejected. */
  forget(segments: Iterable<number>): void {
    for (const segment of segments) {
      this.#cache.discard(segment);
      this.#unreportedDrops.delete(segment);
    }
  }

  /**
   * The messages, once, that tell the server what is gone.
   *
   * @param spared - ids of a plan that is not ready: these must not be evicted now and are told later.
   */
  evictions(spared: ReadonlySet<number>): ClientMessage[] {
    const ids = [...this.#unreportedDrops.keys()].filter((segment) => !spared.has(segment)).sort((a, b) => a - b);
    for (const segment of ids) this.#unreportedDrops.delete(segment);
    const messages: ClientMessage[] = [];
    for (let start = 0; start < ids.length; start += LIMITS.MAX_HELD_SEGMENTS) {
      messages.push({ type: "evict", segments: ids.slice(start, start + LIMITS.MAX_HELD_SEGMENTS) });
    }
    return messages;
  }

  /**
   * Everything held, most recently used first; every eviction is told by what is not in it.
   *
   * What does not fit into `hello` goes into the `held` messages after the welcome.
   */
  offer(): HeldRow[] {
    this.#unreportedDrops.clear();
    const rows: HeldRow[] = [];
    for (const segment of this.#cache.ids().reverse()) {
      const facts = this.#cache.peek(segment)?.facts;
      if (facts !== undefined) rows.push({ segment, xxh3: facts.xxh3 });
    }
    return rows;
  }
}
