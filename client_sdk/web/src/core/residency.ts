/**
 * Which segments are on the GPU, which should be, and when the visible set may change.
 *
 * A segment goes `held` (its payload is here) -> `decoding` -> `decoded` (waiting for, or under, upload) -> `uploaded` ->
 * `resident` (can be drawn at once), and from each of them back. What is *visible* is another matter: it changes in {@link Residency.swap} alone, to
 * exactly what the newest landing's `ready` or `degraded` said, or, until they are here, what `ready` said of the same landing
 * before. (Two exceptions, where there is no choice: a new scene version, and a segment that cannot be decoded again after the
 * graphics context was lost: then the base is drawn alone, until the stream has another plan.)
 *
 * PURE: no I/O, no clock; whoever owns it decodes, uploads, frees, and says so.
 */

import { LandingRecord, type ShowableSet } from "./landing-record.ts";
import { SegmentShelf, type ShelfLimits } from "./segment-shelf.ts";
import { landingKey, ShownBefore } from "./shown-before.ts";
import type { FaceBits, LandOptions, PlanFacts, SegmentFacts, SegmentKey, Vec3 } from "./types.ts";

/** Segments that aims brought and that wait for spare room; beyond it the oldest goes. */
const MAX_PREFETCHED = 4096;

/** How much is done at once, and kept. */
export type ResidencyOptions = ShelfLimits;

/** What one swap changed. */
export interface Swap {
  readonly landing: number;
  readonly degraded: boolean;
  readonly visible: readonly SegmentKey[];
  /** Base faces that are hidden with what is visible. */
  readonly hiddenFaces: FaceBits;
  readonly shown: readonly SegmentKey[];
  readonly hidden: readonly SegmentKey[];
}

/** A segment to be asked of `Stream.mesh`; `epoch` is to be given back with the answer. */
export interface DecodeRequest {
  readonly segment: SegmentKey;
  readonly epoch: number;
}

/** The segments of one stage. Not shared between stages; a call is a step, in whatever order events come. */
export class Residency {
  readonly #shelf: SegmentShelf;
  readonly #shownBefore = new ShownBefore();
  #visible: readonly SegmentKey[] = [];
  #visibleIds = new Set<SegmentKey>();
  #desired: readonly SegmentKey[] = [];
  #desiredIds = new Set<SegmentKey>();
  /** Of what plans and arrivals told of what is desired. */
  #facts = new Map<SegmentKey, SegmentFacts>();
  #prefetched: SegmentKey[] = [];
  #newest: LandingRecord | null = null;
  /** Base faces that are hidden with what is visible. */
  #visibleHidden: FaceBits = new Uint8Array();
  #coming: ShowableSet | null = null;
  #comingRevision = 0;
  #preparedRevision = -1;
  #epoch = 0;
  #restoring = false;

  constructor(options: ResidencyOptions) {
    this.#shelf = new SegmentShelf(options, (segment) => this.#isNeeded(segment));
  }

  /** Segments shown. */
  get visible(): readonly SegmentKey[] {
    return this.#visible;
  }

  /** The newest landing, or null before the first. */
  get newest(): LandingRecord | null {
    return this.#newest;
  }

  /** Number of this scene version, from 0: answers to requests of an earlier one are dropped. */
  get epoch(): number {
    return this.#epoch;
  }

  /** Facts of a segment that the newest landing's plan or what is visible has. */
  factsOf(segment: SegmentKey): SegmentFacts | undefined {
    return this.#facts.get(segment);
  }

  /** Segments being decoded, or decoded and not uploaded. */
  get inFlight(): number {
    return this.#shelf.inFlight;
  }

  /** Whether there is something to decode, upload or free now, or on its way. */
  get isBusy(): boolean {
    const waits = (segment: SegmentKey): boolean => this.#shelf.stepOf(segment) === "held";
    return (
      this.#shelf.inFlight > 0 ||
      this.#shelf.hasFrees ||
      this.#restoring ||
      (this.#newest?.plan !== null && this.#desired.some(waits)) ||
      (this.#shelf.hasSpareRoom && this.#prefetched.some(waits))
    );
  }

  /** GPU bytes of segments there, or on their way, that nobody wants now. */
  get spareBytes(): number {
    return this.#shelf.spareBytes;
  }

  /** Whether the visible set is being uploaded again after the context was lost: only the base is to be drawn. */
  get restoring(): boolean {
    return this.#restoring;
  }

  /** What the next swap will show as far as known, for the base to be prepared; null where nothing is coming. */
  get coming(): ShowableSet | null {
    return this.#coming;
  }

  /** Changes whenever `coming` does. */
  get comingRevision(): number {
    return this.#comingRevision;
  }

  /**
   * A landing was asked for: it is the newest from now on. What the one before wanted is kept until the plan is here, since a
   * short hop wants most of it again. Where the same was shown before, and all of it is on the GPU, it may be shown at once.
   */
  land(landing: number, position: Vec3, radiusM: number, nowMs: number, options?: LandOptions): void {
    const key = landingKey(position, radiusM, options);
    this.#newest = new LandingRecord(landing, position, radiusM, nowMs, key);
    const before = this.#shownBefore.recall(key, landing);
    if (before?.show.every(({ key: segment }) => this.#shelf.stepOf(segment) === "resident")) {
      this.#newest.recall(before);
      this.#takeFacts(before);
      this.#setDesired(before.show.map(({ key: segment }) => segment));
    } else this.#recompute();
  }

  /** A session began: another may have other bounds, so that the same landing shows something else. */
  sessionOpened(): void {
    this.#shownBefore.forget();
  }

  /** Its plan came; once more after a reconnect. */
  planned(plan: PlanFacts): void {
    const landing = this.#landing(plan.landing);
    if (!landing) {
      return;
    }
    landing.planned(plan);
    for (const { key, follows } of plan.show) if (!follows) this.#shelf.hold(key, -1);
    this.#takeFacts(plan);
    this.#setDesired(plan.show.map(({ key }) => key));
    this.#shelf.freeUnneededMeshes();
  }

  /** A segment's payload is here: for a landing, or (null) for an aim. */
  arrived(segment: SegmentKey, bytes: number, landing: number | null): void {
    if (this.#shelf.hold(segment, landing === null ? (this.#newest?.landing ?? 0) : -1)) {
      this.#shelf.forgive(segment);
      this.#recompute();
    }
    this.#newest?.arrived(segment, bytes);
    // What an aim brought waits its turn behind the landing's own; beyond the bound the oldest is the least likely target.
    if (landing === null && !this.#desiredIds.has(segment)) {
      if (this.#prefetched.length === MAX_PREFETCHED) {
        this.#prefetched.shift(); // Its payload stays in memory.
      }
      this.#prefetched.push(segment);
    }
  }

  /** The landing takes long: these may be shown before the rest. */
  degraded(landing: number, segments: readonly SegmentKey[], hidden: FaceBits): void {
    this.#landing(landing)?.degrade(segments, hidden);
    this.#recompute();
  }

  /** Every byte is here: exactly these are to be shown. */
  ready(
    landing: number,
    visible: readonly SegmentKey[],
    hidden: FaceBits,
    missing: readonly SegmentKey[],
    elapsedMs: number,
    payloadBytes: number,
  ): void {
    const record = this.#landing(landing);
    if (!record) {
      return;
    }
    // A reconnect declares what is shown once more: then nothing is to be swapped, and no blink is wasted on it.
    const isShown = record.swapped === "full" && sameKeys(visible, this.#visible);
    record.ready(visible, hidden, missing, elapsedMs, payloadBytes);
    // After a reconnect, or of a return, the same set may be declared once more.
    record.swapped = isShown ? "full" : "nothing";
    if (isShown) this.#remember(record);
    for (const segment of visible) {
      this.#shelf.hold(segment, -1);
    }
    this.#setDesired(visible);
    this.#shelf.freeUnneededMeshes();
  }

  /** The server said no to a landing: what is shown stays. */
  refused(landing: number, message: string): void {
    const record = this.#landing(landing);
    if (record) {
      record.refuse(message);
      this.#setDesired([]);
      this.#shelf.freeUnneededMeshes();
    }
  }

  /**
   * Another scene version: its base hides other faces. Everything is forgotten but `visible`, which stays drawn until
   * {@link clearVisible}. Nothing is put on the list of what is to be freed: the owner keeps what is visible apart.
   */
  versionChanged(): void {
    this.#epoch += 1;
    this.#shelf.clear();
    this.#shownBefore.forget();
    this.#prefetched = [];
    this.#facts = new Map(this.#visible.flatMap((segment) => this.#factsEntry(segment)));
    this.#restoring = false;
    this.#newest?.restart();
    this.#setDesired([]);
  }

  /** The base of the new version is here: nothing of the old one is shown any more. */
  clearVisible(): void {
    this.#restoring = false;
    this.#setVisible([]);
    this.#visibleHidden = new Uint8Array();
    this.#recompute();
  }

  /** What to decode now, most urgent first; marks it so. */
  takeDecodes(): DecodeRequest[] {
    const requests: DecodeRequest[] = [];
    const ask = (segment: SegmentKey): void => {
      if (this.#shelf.tryDecode(segment)) {
        requests.push({ segment, epoch: this.#epoch });
      }
    };
    if (this.#restoring) {
      this.#visible.forEach(ask);
    }
    if (this.#newest?.plan) {
      this.#desired.forEach(ask);
    }
    // What finds no spare room waits for the next swap.
    while (this.#prefetched.length > 0 && this.#shelf.hasRoom && this.#shelf.hasSpareRoom) {
      ask(this.#prefetched.shift()!);
    }
    return requests;
  }

  /** A mesh came that will take `bytes` on the GPU. False where nobody wants it any more: throw it away. */
  decoded(segment: SegmentKey, epoch: number, bytes: number): boolean {
    return epoch === this.#epoch && this.#shelf.take(segment, bytes);
  }

  /**
   * It could not be decoded. The stream loads it again, or makes another plan without it. What was to be restored cannot be:
   * the base is drawn alone until then.
   */
  decodeFailed(segment: SegmentKey, epoch: number): void {
    if (epoch !== this.#epoch) return;
    this.#shelf.fail(segment);
    if (this.#restoring && this.#visibleIds.has(segment)) this.clearVisible();
    else this.#recompute();
  }

  /** The most urgent mesh that waits for its upload, or is in the middle of it. */
  nextUpload(): SegmentKey | null {
    const waits = (segment: SegmentKey): boolean => this.#shelf.stepOf(segment) === "decoded";
    if (this.#restoring) {
      const urgent = this.#visible.find(waits);
      if (urgent !== undefined) {
        return urgent;
      }
    }
    const mostUrgent = this.#desired.find(waits);
    if (mostUrgent !== undefined) {
      return mostUrgent;
    }
    return this.#shelf.anyDecoded();
  }

  /** Whether something that is to be shown is not on the GPU, and may still come. */
  get isComing(): boolean {
    return this.#toShow.some((segment) => this.#isAwaited(segment));
  }

  /** That, most urgent first; without facts where no plan told how large it is. */
  awaited(): readonly { readonly segment: SegmentKey; readonly facts: SegmentFacts | undefined }[] {
    const ids = this.#toShow.filter((segment) => this.#isAwaited(segment));
    return ids.map((segment) => ({ segment, facts: this.#facts.get(segment) }));
  }

  /** All of it is on the GPU. */
  uploaded(segment: SegmentKey): void {
    this.#shelf.uploaded(segment);
  }

  /** And it can be drawn without any further preparation. */
  warmed(segment: SegmentKey): void {
    this.#shelf.warmed(segment);
  }

  /** The base's hidden faces for the coming set of this revision are on the GPU too. */
  basePrepared(revision: number): void {
    this.#preparedRevision = revision;
  }

  /** Ids whose GPU memory, or waiting mesh, is to be freed; each is told once. */
  takeFreed(): SegmentKey[] {
    return this.#shelf.takeFreed();
  }

  /** Whether a swap would show the newest landing: in full, the declared inner part of it, or not yet. */
  presentable(): "full" | "degraded" | null {
    const landing = this.#newest;
    if (!landing || this.#restoring || this.#coming === null || landing.swapped === "full") {
      return null;
    }
    const set = landing.target();
    if (!set || this.#preparedRevision !== this.#comingRevision) {
      return null;
    }
    for (const segment of this.#coming.segments) {
      if (this.#shelf.stepOf(segment) !== "resident") {
        return null;
      }
    }
    return set.isWhole ? "full" : "degraded";
  }

  /** Show what is presentable; null where nothing is. The one place where the visible set changes. */
  swap(): Swap | null {
    const kind = this.presentable();
    const landing = this.#newest;
    if (!kind || !landing || !this.#coming) {
      return null;
    }
    const visible = this.#coming.segments;
    // By key, not by landing: what both sets have stays drawn and is neither shown nor hidden.
    const before = this.#visibleIds;
    const shown = visible.filter((segment) => !before.has(segment));
    const after = new Set(visible);
    const hidden = this.#visible.filter((segment) => !after.has(segment));
    landing.swapped = kind;
    this.#visible = visible;
    this.#visibleIds = after;
    this.#visibleHidden = this.#coming.hidden;
    this.#remember(landing);
    this.#shelf.leaveBehind(landing.landing, hidden);
    this.#prefetched = this.#prefetched.filter((segment) => this.#shelf.isAimedSince(segment, landing.landing));
    this.#recompute();
    const hiddenFaces = this.#visibleHidden;
    return { landing: landing.landing, degraded: kind === "degraded", visible, hiddenFaces, shown, hidden };
  }

  /** Everything on the GPU is gone. The visible set stays what it is, and is uploaded again before anything else. */
  contextLost(): void {
    this.#shelf.loseGpu();
    this.#restoring = this.#visible.length > 0;
    this.#preparedRevision = -1;
  }

  /** While restoring: the base faces to hide, once all of the visible set is on the GPU again; null before. */
  restorable(): FaceBits | null {
    const isBack = this.#restoring && this.#visible.every((segment) => this.#shelf.stepOf(segment) === "resident");
    return isBack ? this.#visibleHidden : null;
  }

  /** The visible set is drawn again. */
  restored(): void {
    this.#restoring = false;
    this.#recompute();
  }

  /** To be called once a frame: notes when the newest landing became presentable in full. */
  settle(nowMs: number): void {
    const landing = this.#newest;
    if (landing && landing.presentableMs === null && this.presentable() === "full") {
      landing.presentableMs = nowMs - landing.askedAtMs;
    }
  }

  /** Share of the newest landing that came and was uploaded, 0 to 1. */
  fraction(): number {
    const landing = this.#newest;
    return landing ? landing.fraction((segment) => this.#shelf.stepOf(segment) === "resident") : 0;
  }

  /** What is shown is all that `ready` said: the same landing will show the same. */
  #remember({ key, plan, missing, readyMs, swapped }: LandingRecord): void {
    const isWhole = swapped === "full" && readyMs !== null && missing.length === 0;
    if (isWhole && plan !== null) this.#shownBefore.remember(key, plan);
  }

  /** Keep facts of what is visible and what the plan has. */
  #takeFacts(plan: PlanFacts): void {
    const visible = this.#visible.flatMap((segment) => this.#factsEntry(segment));
    this.#facts = new Map([...visible, ...plan.show.map((facts) => [facts.key, facts] as const)]);
  }

  #factsEntry(segment: SegmentKey): readonly (readonly [SegmentKey, SegmentFacts])[] {
    const facts = this.#facts.get(segment);
    return facts === undefined ? [] : [[segment, facts]];
  }

  #landing(landing: number): LandingRecord | null {
    return this.#newest?.landing === landing && this.#newest.refusal === null ? this.#newest : null;
  }

  /** What is shown, what is to be, and what the newest plan keeps ready beside it. */
  #isNeeded(segment: SegmentKey): boolean {
    return this.#desiredIds.has(segment) || this.#visibleIds.has(segment);
  }

  /** What is visible and has to be uploaded again, else what the newest plan wants. */
  get #toShow(): readonly SegmentKey[] {
    return this.#restoring ? this.#visible : this.#desired;
  }

  #isAwaited(segment: SegmentKey): boolean {
    const step = this.#shelf.stepOf(segment);
    // What is visible has arrived once; what a plan wants may still arrive.
    if (step === undefined) return !this.#restoring;
    return step !== "uploaded" && step !== "resident" && step !== "failed";
  }

  #setDesired(desired: readonly SegmentKey[]): void {
    this.#desired = desired;
    this.#desiredIds = new Set(desired);
    this.#shelf.trim();
    this.#recompute();
  }

  #setVisible(visible: readonly SegmentKey[]): void {
    this.#visible = visible;
    this.#visibleIds = new Set(visible);
    this.#shelf.trim();
  }

  /** Work out what the next swap will show. */
  #recompute(): void {
    const landing = this.#newest;
    const next = landing && landing.swapped !== "full" ? (landing.target() ?? landing.expected()) : null;
    if (next?.hidden !== this.#coming?.hidden || !sameKeys(next?.segments ?? [], this.#coming?.segments ?? [])) {
      this.#comingRevision += 1;
    }
    this.#coming = next;
  }
}

function sameKeys(a: readonly SegmentKey[], b: readonly SegmentKey[]): boolean {
  return a.length === b.length && a.every((key, index) => key === b[index]);
}
