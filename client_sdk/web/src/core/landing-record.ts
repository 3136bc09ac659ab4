/**
 * What is known of one landing: its plan, what arrived, and what its `degraded` and `ready` said is to be shown.
 *
 * PURE.
 */

import type { FaceBits, PlanFacts, SegmentKey, Vec3 } from "./types.ts";

/** The next set of a landing that may be shown: all of it, or its declared inner part. */
export interface ShowableSet {
  /** Nearest first. */
  readonly segments: readonly SegmentKey[];
  /** Base faces that are hidden with them. */
  readonly hidden: FaceBits;
  /** Whether it is all of the landing, and not the declared inner part. */
  readonly isWhole: boolean;
}

/** One landing, from `land` until a newer one. */
export class LandingRecord {
  plan: PlanFacts | null = null;
  missing: readonly SegmentKey[] = [];
  refusal: string | null = null;
  readyMs: number | null = null;
  presentableMs: number | null = null;
  payloadBytes = 0;
  /** What was shown of it. */
  swapped: "nothing" | "degraded" | "full" = "nothing";
  #inner: ShowableSet | null = null;
  #full: ShowableSet | null = null;
  #loadBytes = new Map<SegmentKey, number>();
  readonly #arrived = new Set<SegmentKey>();

  constructor(
    readonly landing: number,
    readonly position: Vec3,
    readonly radiusM: number,
    readonly askedAtMs: number,
    /** Of {@link landingKey}: what makes another landing the same one. */
    readonly key: string,
  ) {}

  /** It was shown before, in this session, exactly so; the service's own answer follows. */
  recall(plan: PlanFacts): void {
    this.plan = plan;
    this.#full = wholeOf(plan);
  }

  /** A plan came: the first, or another one after a reconnect. What was shown stays shown until the next `ready`. */
  planned(plan: PlanFacts): void {
    const planned = new Set(plan.show.map(({ key }) => key));
    // Recalled, and it is so: not taken back, or eyes that are closed for it would have to close twice.
    const holds =
      this.readyMs === null &&
      this.#full?.segments.length === planned.size &&
      this.#full.segments.every((key) => planned.has(key));
    this.plan = plan;
    // Declared for the plan before; the new one declares its own.
    this.#inner = null;
    if (!holds) this.#full = null;
    this.#loadBytes = new Map(plan.show.filter(({ follows }) => follows).map(({ key, bytes }) => [key, bytes]));
  }

  arrived(key: SegmentKey, bytes: number): void {
    this.#arrived.add(key);
    // An aim's bytes are not this landing's; and `ready` brings the sum that counts.
    if (this.#full === null && this.#loadBytes.has(key)) this.payloadBytes += bytes;
  }

  degrade(segments: readonly SegmentKey[], hidden: FaceBits): void {
    this.#inner = { segments, hidden, isWhole: false };
  }

  ready(
    segments: readonly SegmentKey[],
    hidden: FaceBits,
    missing: readonly SegmentKey[],
    elapsedMs: number,
    payloadBytes: number,
  ): void {
    this.#full = { segments, hidden, isWhole: true };
    this.missing = missing;
    // The first time counts: after a reconnect the same set is only declared once more.
    this.readyMs ??= elapsedMs;
    this.payloadBytes = payloadBytes;
  }

  refuse(message: string): void {
    this.refusal = message;
  }

  /** A new scene version: there is no plan of it yet. */
  restart(): void {
    this.plan = null;
    this.missing = [];
    this.swapped = "nothing";
    this.#inner = null;
    this.#full = null;
    this.#loadBytes.clear();
    this.#arrived.clear();
  }

  /** What may be shown next, once it is on the GPU; null where nothing was declared yet, or the inner part is shown. */
  target(): ShowableSet | null {
    if (this.refusal !== null) return null;
    return this.#full ?? (this.swapped === "degraded" ? null : this.#inner);
  }

  /** What `ready` will presumably say: all of the plan. */
  expected(): ShowableSet | null {
    return this.plan && this.refusal === null ? wholeOf(this.plan) : null;
  }

  /** Bytes that came and were uploaded, of those that must: each half counts once. */
  fraction(isResident: (segment: SegmentKey) => boolean): number {
    if (!this.plan) {
      return 0;
    }
    let totalBytes = 0;
    let doneBytes = 0;
    for (const [segment, bytes] of this.#loadBytes) {
      totalBytes += 2 * bytes;
      doneBytes += (this.#arrived.has(segment) || this.#full ? bytes : 0) + (isResident(segment) ? bytes : 0);
    }
    return totalBytes > 0 ? doneBytes / totalBytes : 1;
  }
}

function wholeOf({ show, hidden }: PlanFacts): ShowableSet {
  return { segments: show.map(({ key }) => key), hidden, isWhole: true };
}
