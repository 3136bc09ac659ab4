/**
 * Which segments are on the GPU, which should be, and when the visible set may change.
 *
 * A segment goes `held` (its payload is here) -> `decoding` -> `decoded` (waiting for, or under, upload) -> `uploaded` ->
 * `resident` (can be drawn at once), and from each of them back. What is *visible* is another matter: it changes in {@link Residency.swap} alone, to
 * exactly what the newest landing's `ready` or `degraded` said, or, until they are here, what `ready` said of the same landing
 * before. (Two exceptions, where there is no choice: a new scene version, and a segment that cannot be decoded again after the
 * graphics context was lost.)
 *
 * PURE: no I/O, no clock; whoever owns it decodes, uploads, frees, and says so.
 */

import { LandingRecord } from "./landing-record.ts";
import { SegmentShelf, type ShelfLimits } from "./segment-shelf.ts";
import { landingKey, ShownBefore } from "./shown-before.ts";
import type { LandOptions, PlanFacts, SegmentSummary, Vec3 } from "./types.ts";

/** Segments that aims brought and that wait for spare room; beyond it the oldest goes. */
const MAX_PREFETCHED = 4096;

/** How much is done at once, and kept. */
export type ResidencyOptions = ShelfLimits;

/** What one swap changed. */
export interface Swap {
  readonly landing: number;
  readonly degraded: boolean;
  /** Ascending. */
  readonly visible: readonly number[];
  readonly shown: readonly number[];
  readonly hidden: readonly number[];
}

/** A segment to be asked of `Stream.mesh`; `epoch` is to be given back with the answer. */
export interface DecodeRequest {
  readonly segment: number;
  readonly epoch: number;
}

/** The segments of one stage. Not shared between stages; a call is a step, in whatever order events come. */
export class Residency {
  readonly #shelf: SegmentShelf;
  readonly #shownBefore = new ShownBefore();
  #visible: readonly number[] = [];
  #visibleIds = new Set<number>();
  #desired: readonly number[] = [];
  #desiredIds = new Set<number>();
  #nearbyIds = new Set<number>();
  /** Of what plans and arrivals told of what is desired. */
  #facts = new Map<number, SegmentSummary>();
  #prefetched: number[] = [];
  #newest: LandingRecord | null = null;
  #coming: readonly number[] | null = null;
  #comingRevision = 0;
  #preparedRevision = -1;
  #epoch = 0;
  #restoring = false;

  constructor(options: ResidencyOptions) {
    this.#shelf = new SegmentShelf(options, (segment) => this.#isNeeded(segment));
  }

  /** Segments shown, ascending. */
  get visible(): readonly number[] {
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

  /** Segments being decoded, or decoded and not uploaded. */
  get inFlight(): number {
    return this.#shelf.inFlight;
  }

  /** Whether there is something to decode, upload or free now, or on its way. */
  get isBusy(): boolean {
    const waits = (segment: number): boolean => this.#shelf.stepOf(segment) === "held";
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

  /** What the next swap will show as far as known, ascending, for the base to be prepared; null where nothing is coming. */
  get coming(): readonly number[] | null {
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
    if (before?.keep.every((segment) => this.#shelf.stepOf(segment) === "resident")) {
      this.#newest.recall(before);
      this.#setDesired(before.keep);
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
    for (const segment of plan.keep) {
      this.#shelf.hold(segment, -1);
    }
    const kept = plan.keep.flatMap((segment) => this.#facts.get(segment) ?? []);
    this.#facts = new Map([...kept, ...plan.load].map((facts) => [facts.segment, facts]));
    this.#nearbyIds = new Set(plan.nearby);
    this.#setDesired([...plan.keep, ...plan.load.map((facts) => facts.segment)]);
    this.#shelf.freeUnneededMeshes();
  }

  /** A segment's payload is here: for a landing, or (null) for an aim. */
  arrived(facts: SegmentSummary, landing: number | null): void {
    if (this.#shelf.hold(facts.segment, landing === null ? (this.#newest?.landing ?? 0) : -1)) {
      this.#shelf.forgive(facts.segment);
      this.#recompute();
    }
    this.#newest?.arrived(facts);
    // What an aim brought waits its turn behind the landing's own; beyond the bound the oldest is the least likely target.
    if (landing === null && !this.#desiredIds.has(facts.segment)) {
      if (this.#prefetched.length === MAX_PREFETCHED) {
        this.#prefetched.shift(); // Its payload stays held.
      }
      this.#prefetched.push(facts.segment);
    }
  }

  /** The deadline passed: these may be shown before the rest. */
  degraded(landing: number, segments: readonly number[]): void {
    this.#landing(landing)?.degrade(segments);
    this.#recompute();
  }

  /** Every byte is here: exactly these are to be shown. */
  ready(
    landing: number,
    visible: readonly number[],
    missing: readonly number[],
    elapsedMs: number,
    payloadBytes: number,
  ): void {
    const record = this.#landing(landing);
    if (!record) {
      return;
    }
    // A reconnect declares what is shown once more: then nothing is to be swapped, and no blink is wasted on it.
    const isShown = record.swapped === "full" && sameIds([...visible].sort(ascending), this.#visible);
    record.ready(visible, missing, elapsedMs, payloadBytes);
    // After a reconnect, or of a return, the same set may be declared once more.
    record.swapped = isShown ? "full" : "nothing";
    if (isShown) this.#remember(record);
    for (const segment of visible) {
      this.#shelf.hold(segment, -1);
    }
    // In the plan's order, nearest first; what the plan did not name last.
    const order = new Map(this.#desired.map((segment, index) => [segment, index]));
    const rankOf = (segment: number): number => order.get(segment) ?? Number.MAX_SAFE_INTEGER;
    this.#setDesired([...visible].sort((a, b) => rankOf(a) - rankOf(b)));
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

  /** The cache let these go: they cannot be decoded any more. What is on the GPU stays. */
  dropped(segments: Iterable<number>): void {
    for (const segment of segments) {
      this.#shelf.drop(segment);
    }
    this.#recompute();
  }

  /**
   * Another scene version: ids mean other segments now. Everything is forgotten but `visible`, which stays drawn until
   * {@link clearVisible}. Nothing is put on the list of what is to be freed: the owner keeps what is visible apart.
   */
  versionChanged(): void {
    this.#epoch += 1;
    this.#shelf.clear();
    this.#shownBefore.forget();
    this.#prefetched = [];
    this.#nearbyIds.clear();
    this.#facts.clear();
    this.#restoring = false;
    this.#newest?.restart();
    this.#setDesired([]);
  }

  /** The base of the new version is here: nothing of the old one is shown any more. */
  clearVisible(): void {
    this.#restoring = false;
    this.#setVisible([]);
    this.#recompute();
  }

  /** What to decode now, most urgent first; marks it so. */
  takeDecodes(): DecodeRequest[] {
    const requests: DecodeRequest[] = [];
    const ask = (segment: number): void => {
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
  decoded(segment: number, epoch: number, bytes: number): boolean {
    return epoch === this.#epoch && this.#shelf.take(segment, bytes);
  }

  /** It could not be decoded: its base faces stay, and it is told as missing. */
  decodeFailed(segment: number, epoch: number): void {
    if (epoch === this.#epoch) {
      this.#shelf.fail(segment);
      this.#recompute();
    }
  }

  /** The most urgent mesh that waits for its upload, or is in the middle of it. */
  nextUpload(): number | null {
    const waits = (segment: number): boolean => this.#shelf.stepOf(segment) === "decoded";
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
  awaited(): readonly { readonly segment: number; readonly facts: SegmentSummary | undefined }[] {
    const ids = this.#toShow.filter((segment) => this.#isAwaited(segment));
    return ids.map((segment) => ({ segment, facts: this.#facts.get(segment) }));
  }

  /** All of it is on the GPU. */
  uploaded(segment: number): void {
    this.#shelf.uploaded(segment);
  }

  /** And it can be drawn without any further preparation. */
  warmed(segment: number): void {
    this.#shelf.warmed(segment);
  }

  /** The base's hidden faces for the coming set of this revision are on the GPU too. */
  basePrepared(revision: number): void {
    this.#preparedRevision = revision;
  }

  /** Ids whose GPU memory, or waiting mesh, is to be freed; each is told once. */
  takeFreed(): number[] {
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
    for (const segment of this.#coming) {
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
    const visible = this.#coming;
    // By id, not by landing: what both sets have stays drawn and is neither shown nor hidden.
    const before = this.#visibleIds;
    const shown = visible.filter((segment) => !before.has(segment));
    const after = new Set(visible);
    const hidden = this.#visible.filter((segment) => !after.has(segment));
    landing.swapped = kind;
    this.#visible = visible;
    this.#visibleIds = after;
    this.#remember(landing);
    this.#shelf.leaveBehind(landing.landing, hidden);
    this.#prefetched = this.#prefetched.filter((segment) => this.#shelf.isAimedSince(segment, landing.landing));
    this.#recompute();
    return { landing: landing.landing, degraded: kind === "degraded", visible, shown, hidden };
  }

  /** Everything on the GPU is gone. The visible set stays what it is, and is uploaded again before anything else. */
  contextLost(): void {
    this.#shelf.loseGpu();
    this.#restoring = this.#visible.length > 0;
    this.#preparedRevision = -1;
  }

  /**
   * While restoring: what of the visible set is back on the GPU, once nothing more will come; null before. A segment that could
   * not be decoded again is not in it.
   */
  restorable(): readonly number[] | null {
    if (!this.#restoring || this.#visible.some((segment) => !this.#isSettled(segment))) {
      return null;
    }
    return this.#visible.filter((segment) => this.#shelf.stepOf(segment) === "resident");
  }

  /** The restorable set is drawn again. It is the visible set, less what could not be decoded again: no hole may stay there. */
  restored(): void {
    const restorable = this.restorable();
    if (restorable) {
      this.#restoring = false;
      this.#setVisible(restorable);
      this.#recompute();
    }
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

  /** What the newest landing's full set lacks: told by the stream, or not decodable. Ascending. */
  missing(): readonly number[] {
    const landing = this.#newest;
    const expected = landing?.target()?.segments ?? landing?.expected() ?? [];
    const failed = expected.filter((segment) => this.#shelf.stepOf(segment) === "failed");
    return [...new Set([...(landing?.missing ?? []), ...failed])].sort(ascending);
  }

  /** What is shown is all that `ready` said: the same landing will show the same. */
  #remember({ key, plan, missing, readyMs, swapped }: LandingRecord): void {
    const isWhole = swapped === "full" && readyMs !== null && missing.length === 0;
    const isShown = (segment: number): boolean => this.#visibleIds.has(segment);
    if (isWhole && plan !== null && this.#newest?.target()?.segments.every(isShown)) {
      this.#shownBefore.remember(key, plan, this.#visible);
    }
  }

  #landing(landing: number): LandingRecord | null {
    return this.#newest?.landing === landing && this.#newest.refusal === null ? this.#newest : null;
  }

  /** What is shown, what is to be, and what the newest plan keeps ready beside it. */
  #isNeeded(segment: number): boolean {
    return this.#desiredIds.has(segment) || this.#visibleIds.has(segment) || this.#nearbyIds.has(segment);
  }

  /** What is visible and has to be uploaded again, else what the newest plan wants. */
  get #toShow(): readonly number[] {
    return this.#restoring ? this.#visible : this.#desired;
  }

  #isAwaited(segment: number): boolean {
    const step = this.#shelf.stepOf(segment);
    // What is visible has arrived once; what a plan wants may still arrive.
    if (step === undefined) return !this.#restoring;
    return step !== "uploaded" && step !== "resident" && step !== "failed";
  }

  /** Whether nothing more will happen to it by itself. */
  #isSettled(segment: number): boolean {
    const step = this.#shelf.stepOf(segment);
    return step === undefined || step === "resident" || step === "failed";
  }

  #setDesired(desired: readonly number[]): void {
    this.#desired = desired;
    this.#desiredIds = new Set(desired);
    this.#shelf.trim();
    this.#recompute();
  }

  #setVisible(visible: readonly number[]): void {
    this.#visible = visible;
    this.#visibleIds = new Set(visible);
    this.#shelf.trim();
  }

  /** Work out what the next swap will show. */
  #recompute(): void {
    const landing = this.#newest;
    const ids = landing && landing.swapped !== "full" ? (landing.target()?.segments ?? landing.expected()) : null;
    const next = ids ? [...ids].filter((segment) => this.#shelf.stepOf(segment) !== "failed").sort(ascending) : null;
    if (!sameIds(next, this.#coming)) {
      this.#coming = next;
      this.#comingRevision += 1;
    }
  }
}

function ascending(a: number, b: number): number {
  return a - b;
}

function sameIds(a: readonly number[] | null, b: readonly number[] | null): boolean {
  if (a === null || b === null) {
    return a === b;
  }
  return a.length === b.length && a.every((id, index) => id === b[index]);
}
