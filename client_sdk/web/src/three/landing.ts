/** One landing, from the call of `land` until a newer one: its plan, what is to be shown, and what is known of it. PURE. */

import type { FaceBits, LandOptions, PlanFacts, SegmentFacts, SegmentKey, StreamEvent, Vec3 } from "../core/types.ts";
import type { LandingPhase, LandingStatus } from "./types.ts";

/** Segments that are shown together, and the faces of the base that are hidden with them. */
export interface ShowableSet {
  /** Nearest first. */
  readonly segments: readonly SegmentFacts[];
  readonly hidden: FaceBits;
  /** Whether it is all of the landing; false for its inner part. */
  readonly isWhole: boolean;
}

type Event<Type extends StreamEvent["type"]> = Extract<StreamEvent, { type: Type }>;

/** What makes two landings the same one: how long the user waits does not change what is shown. */
export function landingKey(position: Vec3, radiusM: number, { coarseRadiusM = 0 }: LandOptions): string {
  return [...position, radiusM, coarseRadiusM].join(" ");
}

/** See the head of the file. */
export class Landing {
  plan: PlanFacts | null = null;
  missing: readonly SegmentKey[] = [];
  refusal: string | null = null;
  readyMs: number | null = null;
  presentableMs: number | null = null;
  payloadBytes = 0;
  /** What was shown of it. */
  shown: "nothing" | "inner" | "whole" = "nothing";
  #inner: ShowableSet | null = null;
  #whole: ShowableSet | null = null;
  #follows = new Set<SegmentKey>();
  readonly #arrived = new Set<SegmentKey>();

  constructor(
    readonly landing: number,
    readonly position: Vec3,
    readonly radiusM: number,
    readonly askedAtMs: number,
    readonly key: string,
  ) {}

  /** The same landing was shown before: its set holds until the service answers. */
  recall(plan: PlanFacts): void {
    this.plan = { ...plan, landing: this.landing };
    this.#whole = setOf(plan);
  }

  /** A plan came: the first one, or another after a reconnect. */
  planned(plan: PlanFacts): void {
    // A recalled set that the plan confirms stays, so that it need not be shown twice.
    const isConfirmed = this.readyMs === null && this.#whole !== null && hasSameKeys(this.#whole.segments, plan.show);
    this.plan = plan;
    this.#follows = new Set(plan.show.flatMap(({ key, follows }) => (follows ? [key] : [])));
    this.#inner = null;
    if (!isConfirmed) this.#whole = null;
  }

  arrived(key: SegmentKey, bytes: number): void {
    this.#arrived.add(key);
    // `ready` brings the final sum.
    if (this.#whole === null && this.#follows.has(key)) this.payloadBytes += bytes;
  }

  degraded({ segments, hidden }: Event<"degraded">): void {
    this.#inner = { segments: this.#factsOf(segments), hidden, isWhole: false };
  }

  ready({ visible, hidden, missing, elapsedMs, payloadBytes }: Event<"ready">, shown: ShowableSet | null): void {
    this.#whole = { segments: this.#factsOf(visible), hidden, isWhole: true };
    this.missing = missing;
    // The first time counts: after a reconnect the same set is only confirmed.
    this.readyMs ??= elapsedMs;
    this.payloadBytes = payloadBytes;
    const isShown = this.shown === "whole" && shown !== null && hasSameKeys(shown.segments, this.#whole.segments);
    this.shown = isShown ? "whole" : "nothing";
  }

  /** Another scene version: it has no plan of that yet. */
  restart(): void {
    this.plan = null;
    this.missing = [];
    this.shown = "nothing";
    this.#inner = null;
    this.#whole = null;
    this.#arrived.clear();
  }

  /** What may be shown next, once it is on the GPU; null where nothing is known to be complete. */
  get target(): ShowableSet | null {
    if (this.refusal !== null || this.shown === "whole") return null;
    return this.#whole ?? (this.shown === "inner" ? null : this.#inner);
  }

  /** That, or what will presumably be shown: all of the plan. */
  get expected(): ShowableSet | null {
    if (this.refusal !== null || this.shown === "whole") return null;
    return this.target ?? (this.plan && setOf(this.plan));
  }

  /** Whether all that the service can deliver was shown, so that the same landing will show the same. */
  get isRepeatable(): boolean {
    return this.shown === "whole" && this.readyMs !== null && this.missing.length === 0;
  }

  /** Bytes that came and were uploaded, of those that must: each half counts once. */
  fraction(isOnGpu: (key: SegmentKey) => boolean): number {
    if (this.plan === null) return 0;
    let [totalBytes, doneBytes] = [0, 0];
    for (const { key, bytes, follows } of this.plan.show) {
      if (!follows) continue;
      totalBytes += 2 * bytes;
      doneBytes += (this.#arrived.has(key) || this.#whole ? bytes : 0) + (isOnGpu(key) ? bytes : 0);
    }
    return totalBytes > 0 ? doneBytes / totalBytes : 1;
  }

  #factsOf(keys: readonly SegmentKey[]): SegmentFacts[] {
    const wanted = new Set(keys);
    return this.plan?.show.filter(({ key }) => wanted.has(key)) ?? [];
  }
}

/** Status of the newest landing. `presentable`: what a swap would show now. */
export function statusOf(
  landing: Landing | null,
  presentable: ShowableSet | null,
  isOnGpu: (key: SegmentKey) => boolean,
): LandingStatus {
  return {
    landing: landing?.landing ?? 0,
    phase: phaseOf(landing, presentable),
    position: landing?.position ?? [0, 0, 0],
    radiusM: landing?.radiusM ?? 0,
    fraction: landing?.fraction(isOnGpu) ?? 0,
    plan: landing?.plan ?? null,
    readyMs: landing?.readyMs ?? null,
    presentableMs: landing?.presentableMs ?? null,
    payloadBytes: landing?.payloadBytes ?? 0,
    missing: landing?.missing ?? [],
    refusal: landing?.refusal ?? null,
  };
}

function phaseOf(landing: Landing | null, presentable: ShowableSet | null): LandingPhase {
  if (landing === null) return "idle";
  if (landing.refusal !== null) return "refused";
  if (landing.shown === "whole") return "shown";
  if (presentable !== null) return presentable.isWhole ? "presentable" : "degraded-presentable";
  return landing.plan === null ? "planning" : "streaming";
}

function setOf({ show, hidden }: PlanFacts): ShowableSet {
  return { segments: show, hidden, isWhole: true };
}

function hasSameKeys(a: readonly SegmentFacts[], b: readonly SegmentFacts[]): boolean {
  return a.length === b.length && a.every(({ key }, at) => key === b[at]!.key);
}
