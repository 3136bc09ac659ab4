/**
 * What the session knows of one landing or prefetch that is on its way.
 *
 * PURE.
 */

import type { LandOptions, SegmentFacts, Vec3 } from "../types.ts";
import type { LandMessage, PlanMessage, PrefetchMessage, TimingsPart } from "../wire/messages.generated.ts";

/** One landing that the user asked for, over as many generations as reconnecting takes. */
export class LandingState {
  /** The session's own number, the same over reconnects. */
  readonly number: number;
  readonly position: Vec3;
  readonly radiusM: number;
  readonly options: LandOptions;
  /** Generation on the present connection; -1 before it was sent there. */
  generation = -1;
  /** Of the load table, and of segments of `keep` that are sent after all, by id. */
  facts = new Map<number, SegmentFacts>();
  /**
   * Facts of segments rejected after this landing was asked for and before its plan came, by id: the plan may still
   * keep them, and the server sends them again (6.4, rule 7).
   */
  readonly crossed = new Map<number, SegmentFacts>();
  /** Ids of load and keep. */
  plannedIds: ReadonlySet<number> = new Set();
  /** Planned ids whose payload is not here yet. */
  waiting = new Set<number>();
  /** Ids of the latest `ready.missing`. */
  missing: ReadonlySet<number> = new Set();
  /** The declared inner set, until it has been reported; null where there is none. */
  inner: readonly number[] | null = null;
  readySeen = false;
  /** Of the newest `ready`. */
  timings: TimingsPart | null = null;
  /** Chunk bytes that came for it, in all its generations. */
  payloadBytes = 0;
  /** Whether it became ready for the client. */
  isDone = false;

  constructor(number: number, position: Vec3, radiusM: number, options: LandOptions) {
    this.number = number;
    this.position = position;
    this.radiusM = radiusM;
    this.options = options;
  }

  /** The message that asks for it under a generation, of a server that allows so large a radius. */
  message(generation: number, maxRadiusM: number): LandMessage {
    return landMessage(generation, this.position, this.radiusM, this.options, maxRadiusM);
  }

  /** Take the plan of a generation, in place of any before. */
  begin(plan: PlanMessage): void {
    this.facts = new Map(plan.load.map((facts) => [facts.segment, facts]));
    this.plannedIds = new Set([...this.facts.keys(), ...plan.keep]);
    this.waiting = new Set(this.facts.keys());
    this.missing = new Set();
    this.inner = null;
    this.readySeen = false;
  }

  /** Wait for a segment of `keep` that is not here after all. */
  expectAgain(facts: SegmentFacts): void {
    this.waiting.add(facts.segment);
    this.facts.set(facts.segment, facts);
  }

  /** Whether it is ready for the client (6.4, rule 5). */
  get complete(): boolean {
    if (!this.readySeen) return false;
    for (const segment of this.waiting) {
      if (!this.missing.has(segment)) return false;
    }
    return true;
  }

  /** What it shows once complete: all that is planned and whole, ascending. */
  get shown(): readonly number[] {
    return [...this.plannedIds].filter((segment) => !this.waiting.has(segment)).sort((a, b) => a - b);
  }
}

/** What an aim brings. */
export interface PrefetchState {
  readonly generation: number;
  readonly facts: ReadonlyMap<number, SegmentFacts>;
  readonly waiting: Set<number>;
  readonly bytes: number;
}

/** State of a prefetch from its announcement: everything in it is still to come. */
export function prefetchState(prefetch: PrefetchMessage): PrefetchState {
  const facts = new Map(prefetch.segments.map((row) => [row.segment, row]));
  return { generation: prefetch.generation, facts, waiting: new Set(facts.keys()), bytes: prefetch.bytes };
}

/** The message that asks for a landing. */
export function landMessage(
  generation: number,
  position: Vec3,
  radiusM: number,
  options: LandOptions,
  maxRadiusM = Number.POSITIVE_INFINITY,
): LandMessage {
  return {
    type: "land",
    generation,
    position,
    radius_m: radiusM,
    coarse_radius_m: ringOf(radiusM, options.coarseRadiusM, maxRadiusM),
    inner_radius_m: options.innerRadiusM,
    deadline_ms: options.deadlineMs,
    stall_ms: options.stallMs,
  };
}

/** The ring's radius, cut to what the server allows: a landing with less coarse ground is better than none. */
export function ringOf(radiusM: number, coarseRadiusM: number | undefined, maxRadiusM: number): number | undefined {
  // One below the radius stays: it is a mistake, and is to be told.
  if (coarseRadiusM === undefined || coarseRadiusM < radiusM) return coarseRadiusM;
  return Math.max(radiusM, Math.min(coarseRadiusM, maxRadiusM));
}
