/**
 * Landings and prefetches on their way: plans and frames in, events and answers out.
 *
 * The part of {@link ClientSession} that decides what is received, held, pinned and shown. Section numbers in comments
 * are those of `spec/wire-protocol.md`.
 *
 * PURE.
 */

import type { SegmentFacts } from "../types.ts";
import type { PayloadFrame } from "../wire/frames.ts";
import type {
  ClientMessage,
  DegradedMessage,
  PlanMessage,
  PrefetchMessage,
  ReadyMessage,
  SupersededMessage,
} from "../wire/messages.generated.ts";
import { AimCounts } from "./aim-counts.ts";
import { Assembler } from "./assembly.ts";
import type { SessionEvent } from "./events.ts";
import type { Holdings } from "./holdings.ts";
import { type LandingState, type PrefetchState, prefetchState } from "./landing-state.ts";
import { ProtocolViolation } from "./violation.ts";

const NOTHING: ReadonlySet<number> = new Set();

/** What {@link Transfers} works with. */
export interface TransferOptions {
  /** What is held; kept up to date here. */
  readonly holdings: Holdings;
  /** As `hello` says. */
  readonly maxGpuBytes: number | undefined;
  /** XXH3-64 of a payload. */
  readonly xxh3: (bytes: Uint8Array) => bigint;
  /** Takes the messages to send, in order. */
  readonly send: (message: ClientMessage) => void;
  /** Takes the events, in order. */
  readonly report: (event: SessionEvent) => void;
}

/** What is on its way on one session, over all its connections. */
export class Transfers {
  /** Ids that the last ready landing shows, ascending. */
  visible: readonly number[] = [];
  /** Chunk bytes taken. */
  payloadBytes = 0;
  /** Those of them that belong to segments which were held already; 0 with a right server. */
  repeatedBytes = 0;
  /** What aims have brought. */
  readonly aims = new AimCounts();
  /** Generation of the newest aim of which everything has come. */
  aimDone = -1;
  readonly #options: TransferOptions;
  readonly #assembler = new Assembler();
  /** Sent, and without a plan yet, oldest first. */
  #unplanned: LandingState[] = [];
  #current: LandingState | null = null;
  #prefetch: PrefetchState | null = null;
  /** Shown perhaps, since a deadline passed: the newest declared inner set. */
  #inner: readonly number[] = [];
  /** Kept beside what is shown: of the newest plan (6.6, rule 3). */
  #nearby: readonly number[] = [];
  #retried = new Set<number>();

  constructor(options: TransferOptions) {
    this.#options = options;
  }

  /** The newest landing that is not ready. */
  get unfinished(): LandingState | null {
    const newest = this.#unplanned.at(-1);
    if (newest !== undefined) return newest;
    return this.#current !== null && !this.#current.isDone ? this.#current : null;
  }

  /** Whether a `land` has no plan yet: then nothing may be evicted (6.7, rule 2). */
  get awaitsPlan(): boolean {
    return this.#unplanned.length > 0;
  }

  /** Ids of the plan that is not ready: these must not be evicted (6.7, rule 2). */
  get openPlan(): ReadonlySet<number> {
    return this.#current !== null && !this.#current.isDone ? this.#current.plannedIds : NOTHING;
  }

  /** Segments that are partly here. */
  get partialCount(): number {
    return this.#assembler.size;
  }

  /** Note that a landing was sent. */
  ask(landing: LandingState): void {
    this.#unplanned.push(landing);
  }

  /** Forget a landing that was never sent; whether it had not ended before. */
  withdraw(landing: LandingState): boolean {
    const count = this.#unplanned.length;
    this.#unplanned = this.#unplanned.filter((queued) => queued !== landing);
    return this.#unplanned.length < count;
  }

  /** Forget a landing that the server refused; an older one goes on (6.5, rule 5). */
  refused(generation: number | undefined): LandingState | null {
    const at = this.#unplanned.findIndex((landing) => landing.generation === generation);
    if (at < 0) return null;
    const [landing] = this.#unplanned.splice(at, 1);
    this.#pinAndTrim();
    return landing ?? null;
  }

  /** Forget parts (10.2); returns the newest landing that is not ready, to ask again. */
  connectionLost(): LandingState | null {
    this.#assembler.clear();
    this.#prefetch = null;
    this.aimDone = -1;
    const current = this.#current;
    this.#current = null;
    // Only the newest is asked again: the others are superseded by it, as on one connection.
    const waiting = current === null || current.isDone ? this.#unplanned : [current, ...this.#unplanned];
    this.#unplanned = [];
    const newest = waiting.at(-1) ?? null;
    for (const landing of waiting.slice(0, -1)) {
      if (newest !== null) this.#options.report({ type: "superseded", landing: landing.number, by: newest.number });
    }
    this.#pin();
    return newest;
  }

  /** Show nothing: the served version is another one, so the ids mean other segments (5.4). */
  hideAll(): void {
    this.visible = [];
    this.#inner = [];
    this.#nearby = [];
    this.#pinAndTrim();
  }

  // ---- messages

  /** Take the plan of the oldest landing that has none. */
  onPlan(plan: PlanMessage): void {
    const landing = this.#unplanned[0];
    if (landing === undefined || landing.generation !== plan.generation) {
      const expected = landing === undefined ? "none" : landing.generation;
      throw new ProtocolViolation(`got a plan of generation ${plan.generation}, expected ${expected}`);
    }
    const { total_gpu_bytes: gpuBytes = 0 } = plan;
    const mostGpuBytes = this.#options.maxGpuBytes ?? gpuBytes;
    // A server that does not know the bound says nothing of it.
    if (gpuBytes > mostGpuBytes) {
      throw new ProtocolViolation(`got ${gpuBytes} GPU bytes, expected at most ${mostGpuBytes} (6.2)`);
    }
    this.#unplanned.shift();
    this.#endCurrent(landing.number);
    this.#current = landing;
    this.#prefetch = null;
    this.#nearby = plan.nearby;
    this.#retried.clear();
    landing.begin(plan);
    // Parts of what the new load has go on where they stopped; all others are forgotten, on both sides (6.5, rule 3).
    this.#assembler.keepOnly(landing.facts);
    this.aims.planned(plan.keep, plan.load.length > 0);
    const lost: number[] = [];
    for (const segment of plan.keep) {
      if (this.#options.holdings.recall(segment) !== undefined) continue;
      const crossed = landing.crossed.get(segment);
      if (crossed === undefined) lost.push(segment);
      // Rejected already, and on its way again in this generation (6.4, rule 7).
      else landing.expectAgain(crossed);
    }
    this.#pinAndTrim();
    this.#options.report({ type: "planned", landing: landing.number, plan });
    for (const segment of lost) this.#askAgain(landing, segment);
  }

  /** Take one of the (one or more) `ready` of the present landing (6.4). */
  onReady(ready: ReadyMessage): void {
    const landing = this.#current;
    if (landing === null || landing.generation !== ready.generation) {
      const expected = landing === null ? "none" : landing.generation;
      throw new ProtocolViolation(`got ready of generation ${ready.generation}, expected ${expected}`);
    }
    landing.readySeen = true;
    landing.missing = new Set(ready.missing);
    landing.timings = ready.timings ?? null;
    this.#finishIfComplete();
  }

  /** Pass on the declared inner set, as soon as all of it is here. */
  onDegraded(degraded: DegradedMessage): void {
    const landing = this.#current;
    if (landing === null || landing.isDone || landing.generation !== degraded.generation) return;
    // Perhaps before all of it is here: it is passed on once it is whole.
    landing.inner = [...degraded.segments].sort((a, b) => a - b);
    this.#degradeIfWhole(landing);
  }

  /** End a landing or a prefetch: no more frames of it come, or never a plan (6.3, 6.5). */
  onSuperseded(message: SupersededMessage): void {
    if (this.#prefetch?.generation === message.generation) {
      this.#prefetch = null;
    } else if (this.#current?.generation === message.generation) {
      this.#endCurrent(this.#unplanned[0]?.number ?? this.#current.number);
      this.#current = null;
    } else if (this.#unplanned[0]?.generation === message.generation) {
      const [{ number }] = this.#unplanned.splice(0, 1) as [LandingState];
      this.#options.report({ type: "superseded", landing: number, by: this.#unplanned[0]?.number ?? number });
    }
  }

  /** Begin to take what an aim brings. */
  onPrefetch(message: PrefetchMessage): void {
    this.#prefetch = prefetchState(message);
    this.aims.prefetching();
    this.#retried.clear();
    this.#assembler.keepOnly(this.#prefetch.facts);
    const { generation, segments, bytes } = message;
    this.#options.report({ type: "prefetching", aim: generation, segments: segments.length, bytes });
    this.#endPrefetchIfDone(this.#prefetch);
  }

  /** Take one chunk; check the hash when it was the last one (4, rule 4). */
  onFrame(frame: PayloadFrame): void {
    const { segment, generation, chunk } = frame;
    const landing = this.#current?.generation === generation ? this.#current : null;
    const prefetch = this.#prefetch?.generation === generation ? this.#prefetch : null;
    // Of a known generation, and of a segment that it loads; counted before the hash is known, as the wire was used.
    const facts = this.#expected(frame, landing, prefetch);
    if (landing !== null) landing.payloadBytes += chunk.byteLength;
    this.payloadBytes += chunk.byteLength;
    if (this.#options.holdings.has(segment)) this.repeatedBytes += chunk.byteLength;
    const payload = this.#assembler.take(frame, facts.length);
    if (payload === null) return;
    // Whole: held only with the right hash, else asked for once more.
    const actual = this.#options.xxh3(payload);
    if (actual !== facts.xxh3) {
      const number = landing?.number ?? null;
      this.#options.report({ type: "rejected", landing: number, segment, actual, expected: facts.xxh3 });
      this.#reject(generation, facts, "hash_mismatch");
      if (landing === null && prefetch !== null) this.#giveUpSecondTime(prefetch, segment);
      return;
    }
    const entry = { facts, payload };
    this.#options.holdings.put(entry);
    this.#options.report({ type: "arrived", landing: landing?.number ?? null, entry });
    if (!this.awaitsPlan) this.#trim();
    if (landing !== null) {
      landing.waiting.delete(segment);
      this.#degradeIfWhole(landing);
      this.#finishIfComplete();
    } else if (prefetch !== null) {
      this.aims.arrived(segment, payload.byteLength);
      prefetch.waiting.delete(segment);
      this.#endPrefetchIfDone(prefetch);
    }
  }

  // ---- private

  #expected(frame: PayloadFrame, landing: LandingState | null, prefetch: PrefetchState | null): SegmentFacts {
    if (landing === null && prefetch === null) {
      throw new ProtocolViolation(`got a frame of generation ${frame.generation}, which no landing or aim has now`);
    }
    const facts = (landing ?? prefetch)?.facts.get(frame.segment);
    if (facts !== undefined) return facts;
    throw new ProtocolViolation(`got segment ${frame.segment}, which generation ${frame.generation} does not load`);
  }

  /** Ask for a segment of `keep` that is not here after all (6.4, rule 4). */
  #askAgain(landing: LandingState, segment: number): void {
    const facts = this.#options.holdings.factsOf(segment);
    if (facts === undefined) {
      throw new ProtocolViolation(`plan ${landing.generation} keeps segment ${segment}, which was never held`);
    }
    landing.expectAgain(facts);
    const { number } = landing;
    this.#options.report({ type: "rejected", landing: number, segment, actual: null, expected: facts.xxh3 });
    this.#reject(landing.generation, facts, "lost");
  }

  /** Tell that a segment is not held; for a landing under way that crosses on the wire. */
  #reject(generation: number, facts: SegmentFacts, reason: string): void {
    const { segment } = facts;
    this.#options.holdings.forget([segment]);
    for (const landing of this.#unplanned) landing.crossed.set(segment, facts);
    this.#options.send({ type: "reject", generation, segment, reason });
  }

  /** Stop waiting for it: a prefetch is sent once more, then no more (6.4, rule 4). */
  #giveUpSecondTime(prefetch: PrefetchState, segment: number): void {
    if (this.#retried.has(segment)) {
      prefetch.waiting.delete(segment);
      this.#endPrefetchIfDone(prefetch);
    }
    this.#retried.add(segment);
  }

  #endCurrent(by: number): void {
    const landing = this.#current;
    if (landing !== null && !landing.isDone) {
      this.#options.report({ type: "superseded", landing: landing.number, by });
    }
  }

  #degradeIfWhole(landing: LandingState): void {
    const inner = landing.inner;
    if (inner?.some((segment) => landing.waiting.has(segment) || !landing.plannedIds.has(segment)) !== false) return;
    landing.inner = null;
    this.#inner = inner;
    this.#options.report({ type: "degraded", landing: landing.number, segments: inner });
  }

  #finishIfComplete(): void {
    const landing = this.#current;
    if (landing === null || landing.isDone || !landing.complete) return;
    landing.isDone = true;
    // From here on pinned as visible, and no longer as planned.
    this.visible = landing.shown;
    this.#inner = [];
    this.#options.report({
      type: "ready",
      landing: landing.number,
      visible: this.visible,
      missing: [...landing.waiting].sort((a, b) => a - b),
      payloadBytes: landing.payloadBytes,
      timings: landing.timings,
    });
    this.#pinAndTrim();
  }

  #endPrefetchIfDone(prefetch: PrefetchState): void {
    if (prefetch.waiting.size > 0) return;
    this.aimDone = prefetch.generation;
    const { generation, facts, bytes } = prefetch;
    this.#options.report({ type: "prefetched", aim: generation, segments: facts.size, bytes });
  }

  #pin(): void {
    this.#options.holdings.pin([...this.visible, ...this.#inner, ...this.openPlan, ...this.#nearby]);
  }

  #pinAndTrim(): void {
    this.#pin();
    if (!this.awaitsPlan) this.#trim();
  }

  #trim(): void {
    const segments = this.#options.holdings.trim();
    if (segments.length > 0) this.#options.report({ type: "dropped", segments });
  }
}
