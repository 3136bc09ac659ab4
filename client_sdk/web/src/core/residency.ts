/**
 * Which segments are on the GPU, which should be, and when the visible set may change.
 *
 * A segment goes `held` (its payload is here) -> `decoding` -> `decoded` (waiting for, or under, upload) -> `uploaded` ->
 * `resident` (can be drawn at once), and from each of them back. What is *visible* is another matter: it changes in {@link Residency.swap} alone, to
 * exactly what the newest landing's `ready` or `degraded` said. (Two exceptions, where there is no choice: a new scene version,
 * and a segment that cannot be decoded again after the graphics context was lost.)
 *
 * PURE: no I/O, no clock; whoever owns it decodes, uploads, frees, and says so.
 */

import { InFlight, type InFlightLimits } from "./in-flight.ts";
import { LandingRecord } from "./landing-record.ts";
import type { PlanFacts, SegmentFacts, Vec3 } from "./types.ts";

/** How much is done at once, and kept. */
export interface ResidencyOptions extends InFlightLimits {
  /** GPU bytes of segments that are neither visible nor wanted by the newest landing: what an aim brought. */
  readonly spareBytes: number;
}

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

type Step = "held" | "decoding" | "decoded" | "uploaded" | "resident" | "failed";

interface Entry {
  step: Step;
  /** On the GPU, once decoded. */
  bytes: number;
  /** Newest landing when an aim brought it, or -1: it came for a landing. */
  aimedDuring: number;
  /** When it was last wanted or brought, as a running number. */
  usedAt: number;
}

/** The segments of one stage. Not shared between stages; a call is a step, in whatever order events come. */
export class Residency {
  readonly #options: ResidencyOptions;
  readonly #inFlight: InFlight;
  readonly #entries = new Map<number, Entry>();
  #visible: readonly number[] = [];
  #visibleIds = new Set<number>();
  #wanted: readonly number[] = [];
  #wantedIds = new Set<number>();
  #prefetched: number[] = [];
  #toFree: number[] = [];
  #newest: LandingRecord | null = null;
  #coming: readonly number[] | null = null;
  #comingRevision = 0;
  #preparedRevision = -1;
  #spareBytes = 0;
  #epoch = 0;
  #tick = 0;
  #restoring = false;

  constructor(options: ResidencyOptions) {
    this.#options = options;
    this.#inFlight = new InFlight(options);
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
    return this.#inFlight.count;
  }

  /** GPU bytes of segments there, or on their way, that nobody wants now. */
  get spareBytes(): number {
    return this.#spareBytes;
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
   * short hop wants most of it again.
   */
  land(landing: number, position: Vec3, radiusM: number, nowMs: number): void {
    this.#newest = new LandingRecord(landing, position, radiusM, nowMs);
    this.#recompute();
  }

  /** Its plan came; once more after a reconnect. */
  planned(plan: PlanFacts): void {
    const landing = this.#landing(plan.landing);
    if (!landing) {
      return;
    }
    landing.planned(plan);
    for (const segment of plan.keep) {
      this.#hold(segment, -1);
    }
    this.#setWanted([...plan.keep, ...plan.load.map((facts) => facts.segment)]);
    this.#dropUnwantedMeshes();
  }

  /** A segment's payload is here: for a landing, or (null) for an aim. */
  arrived(facts: SegmentFacts, landing: number | null): void {
    const entry = this.#hold(facts.segment, landing === null ? (this.#newest?.landing ?? 0) : -1);
    if (entry.step === "failed") {
      entry.step = "held"; // It came once more: perhaps whole this time.
      this.#recompute();
    }
    this.#newest?.arrived(facts);
    if (landing === null && !this.#wantedIds.has(facts.segment)) {
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
    const isShown = record.swapped === "full" && sameIds([...visible].sort(ascending), this.#visible);
    record.ready(visible, missing, elapsedMs, payloadBytes);
    record.swapped = isShown ? "full" : "nothing"; // After a reconnect the same set may be declared once more.
    for (const segment of visible) {
      this.#hold(segment, -1);
    }
    // In the plan's order, nearest first; what the plan did not name last.
    const order = new Map(this.#wanted.map((segment, index) => [segment, index]));
    const place = (segment: number): number => order.get(segment) ?? Number.MAX_SAFE_INTEGER;
    this.#setWanted([...visible].sort((a, b) => place(a) - place(b)));
    this.#dropUnwantedMeshes();
  }

  /** The server said no to a landing: what is shown stays. */
  refused(landing: number, message: string): void {
    const record = this.#landing(landing);
    if (record) {
      record.refuse(message);
      this.#setWanted([]);
      this.#dropUnwantedMeshes();
    }
  }

  /** The cache let these go: they cannot be decoded any more. What is on the GPU stays. */
  dropped(segments: Iterable<number>): void {
    for (const segment of segments) {
      const entry = this.#entries.get(segment);
      if (entry?.step === "held" && this.#isNeeded(segment)) {
        entry.step = "failed";
      } else if (entry?.step === "held" || entry?.step === "failed") {
        this.#entries.delete(segment);
      }
    }
    this.#recompute();
  }

  /**
   * Another scene version: ids mean other segments now. Everything is forgotten but `visible`, which stays drawn until
   * {@link clearVisible}. Nothing is put on the list of what is to be freed: the owner keeps what is visible apart.
   */
  versionChanged(): void {
    this.#epoch += 1;
    this.#entries.clear();
    this.#prefetched = [];
    this.#toFree = [];
    this.#inFlight.clear();
    this.#spareBytes = 0;
    this.#restoring = false;
    this.#newest?.restart();
    this.#setWanted([]);
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
      const entry = this.#entries.get(segment);
      if (entry?.step === "held" && this.#inFlight.hasRoom) {
        entry.step = "decoding";
        this.#inFlight.ask();
        requests.push({ segment, epoch: this.#epoch });
      }
    };
    if (this.#restoring) {
      this.#visible.forEach(ask);
    }
    if (this.#newest?.plan) {
      this.#wanted.forEach(ask);
    }
    while (this.#prefetched.length > 0 && this.#inFlight.hasRoom) {
      const segment = this.#prefetched[0]!;
      if (this.#spareBytes >= this.#options.spareBytes) {
        break; // Room comes with the next swap.
      }
      this.#prefetched.shift();
      ask(segment);
    }
    return requests;
  }

  /** A mesh came that will take `bytes` on the GPU. False where nobody wants it any more: throw it away. */
  decoded(segment: number, epoch: number, bytes: number): boolean {
    const entry = this.#entries.get(segment);
    if (epoch !== this.#epoch || entry?.step !== "decoding") {
      return false;
    }
    const isRefused = entry.aimedDuring < 0 || this.#spareBytes + bytes > this.#options.spareBytes;
    if (!this.#isNeeded(segment) && isRefused) {
      entry.step = "held";
      this.#inFlight.dismiss();
      return false;
    }
    entry.step = "decoded";
    entry.bytes = bytes;
    entry.usedAt = this.#nextTick();
    this.#inFlight.wait(bytes);
    if (!this.#isNeeded(segment)) {
      this.#spareBytes += bytes;
    }
    return true;
  }

  /** It could not be decoded: its base faces stay, and it is told as missing. */
  decodeFailed(segment: number, epoch: number): void {
    const entry = this.#entries.get(segment);
    if (epoch === this.#epoch && entry?.step === "decoding") {
      entry.step = "failed";
      this.#inFlight.dismiss();
      this.#recompute();
    }
  }

  /** The most urgent mesh that waits for its upload, or is in the middle of it. */
  nextUpload(): number | null {
    const waits = (segment: number): boolean => this.#entries.get(segment)?.step === "decoded";
    if (this.#restoring) {
      const urgent = this.#visible.find(waits);
      if (urgent !== undefined) {
        return urgent;
      }
    }
    const wanted = this.#wanted.find(waits);
    if (wanted !== undefined) {
      return wanted;
    }
    for (const [segment, entry] of this.#entries) {
      if (entry.step === "decoded") {
        return segment;
      }
    }
    return null;
  }

  /** All of it is on the GPU. */
  uploaded(segment: number): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "decoded") {
      entry.step = "uploaded";
      this.#inFlight.leave(entry.bytes);
    }
  }

  /** And it can be drawn without any further preparation. */
  warmed(segment: number): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "uploaded") {
      entry.step = "resident";
    }
  }

  /** The base's hidden faces for the coming set of this revision are on the GPU too. */
  basePrepared(revision: number): void {
    this.#preparedRevision = revision;
  }

  /** Ids whose GPU memory, or waiting mesh, is to be freed; each is told once. */
  takeFreed(): number[] {
    const freed = this.#toFree;
    this.#toFree = [];
    return freed;
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
      if (this.#entries.get(segment)?.step !== "resident") {
        return null;
      }
    }
    return set.whole ? "full" : "degraded";
  }

  /** Show what is presentable; null where nothing is. The one place where the visible set changes. */
  swap(): Swap | null {
    const kind = this.presentable();
    const landing = this.#newest;
    if (!kind || !landing || !this.#coming) {
      return null;
    }
    const visible = this.#coming;
    const before = this.#visibleIds;
    const shown = visible.filter((segment) => !before.has(segment));
    const after = new Set(visible);
    const hidden = this.#visible.filter((segment) => !after.has(segment));
    landing.swapped = kind;
    this.#visible = visible;
    this.#visibleIds = after;
    this.#freeLeftBehind(landing.landing, new Set(hidden));
    this.#recompute();
    return { landing: landing.landing, degraded: kind === "degraded", visible, shown, hidden };
  }

  /** Everything on the GPU is gone. The visible set stays what it is, and is uploaded again before anything else. */
  contextLost(): void {
    for (const [segment, entry] of this.#entries) {
      if (isOnGpu(entry)) {
        this.#free(segment, entry);
      }
    }
    this.#toFree = []; // There is nothing to be freed any more.
    this.#spareBytes = 0;
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
    return this.#visible.filter((segment) => this.#entries.get(segment)?.step === "resident");
  }

  /** The restorable set is drawn again. It is the visible set, less what could not be decoded again: no hole may stay there. */
  restored(): void {
    const there = this.restorable();
    if (there) {
      this.#restoring = false;
      this.#setVisible(there);
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
    return landing ? landing.fraction((segment) => this.#entries.get(segment)?.step === "resident") : 0;
  }

  /** What the newest landing's full set lacks: told by the stream, or not decodable. Ascending. */
  missing(): readonly number[] {
    const landing = this.#newest;
    const expected = landing?.target()?.segments ?? landing?.expected() ?? [];
    const failed = expected.filter((segment) => this.#entries.get(segment)?.step === "failed");
    return [...new Set([...(landing?.missing ?? []), ...failed])].sort(ascending);
  }

  #landing(landing: number): LandingRecord | null {
    return this.#newest?.landing === landing && this.#newest.refusal === null ? this.#newest : null;
  }

  #nextTick(): number {
    this.#tick += 1;
    return this.#tick;
  }

  #hold(segment: number, aimedDuring: number): Entry {
    let entry = this.#entries.get(segment);
    if (!entry) {
      entry = { step: "held", bytes: 0, aimedDuring, usedAt: this.#nextTick() };
      this.#entries.set(segment, entry);
    }
    entry.aimedDuring = Math.max(entry.aimedDuring, aimedDuring);
    return entry;
  }

  #isNeeded(segment: number): boolean {
    return this.#wantedIds.has(segment) || this.#visibleIds.has(segment);
  }

  #isSpare(segment: number, entry: Entry): boolean {
    return isOnGpu(entry) && !this.#isNeeded(segment);
  }

  #isSettled(segment: number): boolean {
    const entry = this.#entries.get(segment);
    return entry === undefined || entry.step === "resident" || entry.step === "failed";
  }

  #setWanted(wanted: readonly number[]): void {
    this.#wanted = wanted;
    this.#wantedIds = new Set(wanted);
    this.#recountSpare();
    this.#recompute();
  }

  #setVisible(visible: readonly number[]): void {
    this.#visible = visible;
    this.#visibleIds = new Set(visible);
    this.#recountSpare();
  }

  #recountSpare(): void {
    this.#spareBytes = 0;
    for (const [segment, entry] of this.#entries) {
      if (this.#isSpare(segment, entry)) {
        this.#spareBytes += entry.bytes;
      }
    }
    this.#trim();
  }

  /** Free spare segments, the longest unused first, until they fit. */
  #trim(): void {
    if (this.#spareBytes <= this.#options.spareBytes) {
      return;
    }
    const spare = [...this.#entries].filter(([segment, entry]) => this.#isSpare(segment, entry));
    spare.sort((a, b) => a[1].usedAt - b[1].usedAt);
    for (const [segment, entry] of spare) {
      if (this.#spareBytes <= this.#options.spareBytes) {
        break;
      }
      this.#spareBytes -= entry.bytes;
      this.#free(segment, entry);
    }
  }

  #free(segment: number, entry: Entry): void {
    if (entry.step === "decoded") {
      this.#inFlight.leave(entry.bytes);
    }
    entry.step = "held"; // The payload is still here.
    this.#toFree.push(segment);
  }

  /** Meshes that wait for a landing that nobody wants any more take memory and give nothing. */
  #dropUnwantedMeshes(): void {
    for (const [segment, entry] of this.#entries) {
      if (entry.step === "decoded" && !this.#isNeeded(segment) && entry.aimedDuring < 0) {
        this.#free(segment, entry);
      }
    }
    this.#recountSpare();
  }

  /** After a swap: what was shown before, and whatever came for earlier landings and aims. */
  #freeLeftBehind(landing: number, hidden: ReadonlySet<number>): void {
    for (const [segment, entry] of this.#entries) {
      if (isOnGpu(entry) && !this.#isNeeded(segment) && (hidden.has(segment) || entry.aimedDuring < landing)) {
        this.#free(segment, entry);
      }
    }
    this.#prefetched = this.#prefetched.filter((segment) => (this.#entries.get(segment)?.aimedDuring ?? -1) >= landing);
    this.#recountSpare();
  }

  /** Work out what the next swap will show. */
  #recompute(): void {
    const landing = this.#newest;
    const ids = landing && landing.swapped !== "full" ? (landing.target()?.segments ?? landing.expected()) : null;
    const next = ids
      ? [...ids].filter((segment) => this.#entries.get(segment)?.step !== "failed").sort(ascending)
      : null;
    if (!sameIds(next, this.#coming)) {
      this.#coming = next;
      this.#comingRevision += 1;
    }
  }
}

/** Or on its way there, with memory of its own. */
function isOnGpu(entry: Entry): boolean {
  return entry.step === "decoded" || entry.step === "uploaded" || entry.step === "resident";
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
