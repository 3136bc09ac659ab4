/**
 * The segments of a terrain: which of them are decoded and uploaded, which are shown, and when that may change.
 *
 * What is shown changes in {@link SegmentSet.swap} alone, to exactly what the stream declared complete; in
 * {@link SegmentSet.hideAll}, where another version replaces this one; and around a loss of the graphics context.
 *
 * A segment is decoded when its payload is here and the newest plan shows it; then what a prefetch brought, as far as there
 * is spare memory. What a landing hides stays as spare, for a user who comes back; the least recently used goes first.
 */

import type { Group } from "three";

import { gpuBytesOf } from "../core/gpu-budget.ts";
import type { LandOptions, MeshData, PlanFacts, SegmentKey, StreamEvent, Vec3 } from "../core/types.ts";
import type { GpuStore } from "./gpu-store.ts";
import type { GroundMaterial } from "./ground-material.ts";
import { Landing, landingKey, type ShowableSet } from "./landing.ts";
import { closeImage } from "./mesh-upload.ts";
import { type ComingMesh, Pages } from "./pages.ts";
import { SegmentGround } from "./segment-ground.ts";

/** Segments that are decoded, or wait for their upload. Small ones need many, since each takes two frames. */
const MAX_IN_FLIGHT = 16;
/** GPU bytes of those: textures take up to 22 MB each. */
const MAX_IN_FLIGHT_BYTES = 64 * 1024 * 1024;
/** GPU bytes that a segment is taken to have before some were decoded: between vertex colours and a large texture. */
const FIRST_GUESS_BYTES = 6 * 1024 * 1024;
/** How fast that guess follows what came. */
const GUESS_SHARE = 0.25;
/** Prefetched segments that wait for spare memory; beyond it the oldest stay in the stream's cache. */
const MAX_PREFETCHED = 4096;
/** Landings that can be shown again before the service answers. */
const MAX_REMEMBERED = 32;
/** Segments that are freed, and pages that are drawn for the first time, in one frame. */
const MAX_FRAME_FREES = 8;
const MAX_FRAME_WARMINGS = 8;

/** What one swap changed. */
export interface Swap {
  readonly shown: readonly SegmentKey[];
  readonly hidden: readonly SegmentKey[];
  readonly isWhole: boolean;
}

/** What a set works with. */
export interface SegmentSetOptions {
  readonly parent: Group;
  readonly store: GpuStore;
  readonly material: GroundMaterial;
  /** GPU bytes of everything in the store; see {@link Pages}. */
  readonly maxGpuBytes: number;
  /** GPU bytes of segments that are neither shown nor of the newest plan. */
  readonly spareGpuBytes: number;
  readonly decode: (key: SegmentKey) => Promise<MeshData>;
}

/** See the head of the file. Call `update` and then `step` in each frame. */
export class SegmentSet {
  readonly #options: SegmentSetOptions;
  readonly #pages: Pages;
  /** Decoded segments of this version, on the GPU or on their way. */
  readonly #grounds = new Map<SegmentKey, SegmentGround>();
  /** Those that are shown: of these, or, after a change of version, of the old one. */
  readonly #shown = new Map<SegmentKey, SegmentGround>();
  /** What is to be shown: that of {@link #shown}, unless the graphics context was lost. */
  #visible: ShowableSet | null = null;
  readonly #freeing: SegmentGround[] = [];
  /** Segments whose payload is in the stream's memory, as far as a plan or an arrival said. */
  #held = new Set<SegmentKey>();
  /** Replaced when answers that are under way have become useless. */
  #decoding = new Set<SegmentKey>();
  #guessBytes = FIRST_GUESS_BYTES;
  #newest: Landing | null = null;
  /** Keys of the newest plan, nearest first. */
  #wanted: ReadonlySet<SegmentKey> = new Set();
  #prefetched: SegmentKey[] = [];
  /** GPU bytes of prefetched segments that were decoded since the newest landing. */
  #prefetchedBytes = 0;
  readonly #remembered = new Map<string, PlanFacts>();
  #isRestoring = false;
  #measureName: string | null = null;

  constructor(options: SegmentSetOptions) {
    this.#options = options;
    const { parent, store, material, maxGpuBytes, decode } = options;
    this.#pages = new Pages(parent, store, material, maxGpuBytes, (key) => decode(key).then(({ image }) => image));
  }

  get newest(): Landing | null {
    return this.#newest;
  }

  /** Segments that are drawn, by key. */
  get shown(): ReadonlyMap<SegmentKey, SegmentGround> {
    return this.#shown;
  }

  /** What is to be shown, also while it is uploaded again after a loss of the graphics context. */
  get visible(): ShowableSet | null {
    return this.#visible;
  }

  /** Segments with memory of their own on the GPU, and the pages that they lie in: one draw call each. */
  get count(): number {
    return this.#grounds.size;
  }

  get pageCount(): number {
    return this.#pages.count;
  }

  get pickingBytes(): number {
    return [...this.#grounds.values()].reduce((sum, { boxes }) => sum + boxes.bytes, 0);
  }

  get shownFaces(): number {
    return [...this.#shown.values()].reduce((sum, { faceCount }) => sum + faceCount, 0);
  }

  /** Whether the next frames have something to do. */
  get isBusy(): boolean {
    const canDecode = (key: SegmentKey): boolean => this.#canDecode(key);
    return (
      this.#isRestoring ||
      this.#decoding.size > 0 ||
      this.#freeing.length > 0 ||
      this.#pages.coldCount > 0 ||
      this.#isUntidy ||
      this.#notWhole().length > 0 ||
      [...this.#wanted].some(canDecode) ||
      (this.#hasPrefetchRoom && this.#prefetched.some(canDecode))
    );
  }

  /** Whether a segment can be drawn at once. */
  isOnGpu(key: SegmentKey): boolean {
    return this.#grounds.get(key)?.isWarm === true;
  }

  /** What the base must be prepared for: the set that is restored, or the one that is shown next. */
  get next(): ShowableSet | null {
    return this.#isRestoring ? this.#visible : (this.#newest?.expected ?? null);
  }

  /** The set that a swap may show, as far as segments decide; null where none is complete on the GPU. */
  get presentable(): ShowableSet | null {
    const target = this.#isRestoring ? null : (this.#newest?.target ?? null);
    return target !== null && this.#isComplete(target) ? target : null;
  }

  /** The set to be drawn again after a loss of the graphics context, once all of it is on the GPU. */
  get restorable(): ShowableSet | null {
    return this.#isRestoring && this.#visible !== null && this.#isComplete(this.#visible) ? this.#visible : null;
  }

  // ---- what the stream says

  /** A landing was asked for. Where the same was shown before and all of it is on the GPU, it may be shown at once. */
  land(landing: number, position: Vec3, radiusM: number, nowMs: number, options: LandOptions): void {
    const key = landingKey(position, radiusM, options);
    this.#newest = new Landing(landing, position, radiusM, nowMs, key);
    this.#prefetched = [];
    this.#prefetchedBytes = 0;
    const before = this.#remembered.get(key);
    if (before?.show.every((facts) => this.isOnGpu(facts.key))) {
      this.#newest.recall(before);
      this.#want(before);
    }
    // Otherwise what the plan before wanted stays until the new one is here: a short hop wants most of it again.
  }

  /** Take an event of the stream. */
  handle(event: StreamEvent): void {
    if (event.type === "opened") {
      this.#remembered.clear(); // Other limits may show another set.
      return;
    }
    if (event.type === "arrived") {
      const { key, bytes, landing } = event;
      this.#held.add(key);
      this.#newest?.arrived(key, bytes);
      if (landing !== null || this.#wanted.has(key)) return;
      if (this.#prefetched.length === MAX_PREFETCHED) this.#prefetched.shift();
      this.#prefetched.push(key);
      return;
    }
    const landing = this.#newest;
    if (landing === null || landing.refusal !== null) return;
    if (event.type === "planned" && event.plan.landing === landing.landing) {
      const { plan } = event;
      landing.planned(plan);
      const isPlanned = new Set(plan.show.map(({ key }) => key));
      this.#held = new Set([...this.#held].filter((key) => isPlanned.has(key)));
      for (const { key, follows } of plan.show) if (!follows) this.#held.add(key);
      this.#want(plan);
    } else if (event.type === "degraded" && event.landing === landing.landing) landing.degraded(event);
    else if (event.type === "ready" && event.landing === landing.landing) {
      landing.ready(event, this.#visible);
      for (const key of event.visible) this.#held.add(key);
      this.#remember();
    } else if (event.type === "refused" && event.landing === landing.landing) {
      landing.refusal = event.message;
      this.#wanted = new Set();
      this.#freeUnneeded();
    }
  }

  // ---- frames

  /**
   * Begin a frame: what the last one drew for the first time is warm; decode, and free a little.
   *
   * @param canDecode - false while the attributes' scales of the version are not here.
   */
  update(canDecode: boolean): void {
    this.#pages.endWarming();
    if (canDecode) this.#decodeNext();
    for (const ground of this.#freeing.splice(0, MAX_FRAME_FREES)) ground.free();
  }

  /** Upload one slice of the most urgent segment, or move one between pages. Returns its bytes, or 0 where this frame can do no more. */
  step(): number {
    const ground = this.#nextUpload();
    // What is on its way may still fill room that looks empty.
    if (ground === undefined) return this.#isUntidy ? this.#pages.tidy() : 0;
    // Each new page is drawn once without a range: too many at a time would make that frame a long one.
    if (this.#pages.coldCount >= MAX_FRAME_WARMINGS) return 0;
    return ground.step(() => this.#comingAfter(ground)) || this.#pages.tidy();
  }

  /** Note when the newest landing became presentable in full. */
  settle(nowMs: number, presentable: ShowableSet | null): void {
    const landing = this.#newest;
    if (landing !== null && presentable?.isWhole) landing.presentableMs ??= nowMs - landing.askedAtMs;
  }

  /** Show a set that is complete on the GPU, and nothing else: flags alone. */
  swap(set: ShowableSet): Swap {
    const keys = new Set(set.segments.map(({ key }) => key));
    const hidden = [...this.#shown.keys()].filter((key) => !keys.has(key));
    const shown = [...keys].filter((key) => !this.#shown.has(key));
    for (const key of hidden) {
      const ground = this.#shown.get(key)!;
      ground.isShown = false;
      ground.usedAtMs = performance.now();
      this.#shown.delete(key);
      // Of the version before: nobody can come back to it.
      if (this.#grounds.get(key) !== ground) this.#free(ground);
    }
    this.#show(set);
    if (this.#newest !== null) this.#newest.shown = set.isWhole ? "whole" : "inner";
    this.#remember();
    this.#freeUnneeded();
    return { shown, hidden, isWhole: set.isWhole };
  }

  // ---- versions and the graphics context

  /** Another scene version: what is shown stays drawn until {@link hideAll}; everything else is forgotten. */
  leaveVersion(): void {
    for (const [key, ground] of this.#grounds) if (this.#shown.get(key) !== ground) this.#free(ground);
    this.#pages.leaveVersion();
    this.#forget();
    this.#remembered.clear();
    this.#isRestoring = false;
    this.#newest?.restart();
  }

  /** Show nothing any more: the base of the new version is here. */
  hideAll(): void {
    for (const [key, ground] of this.#shown) {
      ground.isShown = false;
      if (this.#grounds.get(key) !== ground) this.#free(ground);
    }
    this.#shown.clear();
    this.#visible = null;
    this.#isRestoring = false;
  }

  /** Everything on the GPU is gone. What was shown is uploaded again before anything else. */
  contextLost(): void {
    const held = this.#held;
    const wanted = this.#wanted;
    this.freeAll();
    this.#held = new Set([...held, ...(this.#visible?.segments.map(({ key }) => key) ?? [])]);
    this.#wanted = wanted;
    this.#isRestoring = this.#visible !== null;
  }

  /** Draw {@link restorable} again. */
  restore(): void {
    if (this.#visible !== null) this.#show(this.#visible);
    this.#isRestoring = false;
  }

  /** Free everything at once. */
  freeAll(): void {
    for (const ground of new Set([...this.#grounds.values(), ...this.#shown.values(), ...this.#freeing])) ground.free();
    this.#pages.freeAll();
    this.#shown.clear();
    this.#freeing.length = 0;
    this.#forget();
  }

  // ---- how it is drawn

  /** Tint these, and no others. */
  markFresh(keys: ReadonlySet<SegmentKey>): void {
    for (const [key, ground] of this.#shown) ground.isFresh = keys.has(key);
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    this.#measureName = name;
    this.#pages.setMeasure(name);
    for (const ground of [...this.#grounds.values(), ...this.#shown.values()]) ground.setMeasure(name);
  }

  /** Apply a change of the shading. */
  dress(): void {
    this.#pages.dress();
  }

  /** Count and hash (FNV-1a) of the segments that are really drawn. */
  digest(): string {
    const drawn = [...this.#shown].filter(([, { isShown }]) => isShown).map(([key]) => key);
    let hash = 0x811c9dc5;
    for (const character of drawn.sort().join()) hash = Math.imul(hash ^ character.charCodeAt(0), 0x01000193);
    return `${drawn.length}:${(hash >>> 0).toString(16)}`;
  }

  // ---- decoding

  #canDecode(key: SegmentKey): boolean {
    return this.#held.has(key) && !this.#decoding.has(key) && !this.#grounds.has(key);
  }

  /** There is always room for one. */
  #hasRoom(): boolean {
    const waiting = this.#notWhole();
    const bytes = waiting.reduce((sum, ground) => sum + ground.gpuBytes, 0);
    const count = waiting.length + this.#decoding.size;
    const expected = bytes + (this.#decoding.size + 1) * this.#guessBytes;
    return count === 0 || (count < MAX_IN_FLIGHT && expected <= MAX_IN_FLIGHT_BYTES);
  }

  get #hasPrefetchRoom(): boolean {
    return this.#prefetchedBytes < this.#options.spareGpuBytes;
  }

  #decodeNext(): void {
    for (const key of this.#order) {
      if (!this.#canDecode(key)) continue;
      if (!this.#hasRoom()) return;
      this.#decode(key, false);
    }
    while (this.#prefetched.length > 0 && this.#hasPrefetchRoom && this.#hasRoom()) {
      const key = this.#prefetched.shift()!;
      if (this.#canDecode(key)) this.#decode(key, true);
    }
  }

  #decode(key: SegmentKey, isPrefetched: boolean): void {
    const decoding = this.#decoding;
    decoding.add(key);
    this.#options.decode(key).then(
      (data) => {
        decoding.delete(key);
        // Bitmaps are closed wherever a mesh is not taken: their memory is not collected in time.
        if (decoding !== this.#decoding || !this.#take(key, data, isPrefetched)) closeImage(data.image);
      },
      () => {
        decoding.delete(key);
        if (decoding === this.#decoding) this.#onFailure(key);
      },
    );
  }

  /** Keep a decoded mesh; false where nobody wants it any more. */
  #take(key: SegmentKey, data: MeshData, isPrefetched: boolean): boolean {
    const bytes = gpuBytesOf(data);
    this.#guessBytes += GUESS_SHARE * (bytes - this.#guessBytes);
    if (!isPrefetched && !this.#isNeeded(key)) return false;
    if (isPrefetched) this.#prefetchedBytes += bytes;
    const { store } = this.#options;
    const now = performance.now();
    this.#grounds.set(key, new SegmentGround(store, this.#pages, key, data, bytes, this.#measureName, now));
    this.#trim();
    return true;
  }

  /** It could not be decoded: the stream loads it again, or makes another plan. Until then nothing can be restored with it. */
  #onFailure(key: SegmentKey): void {
    this.#held.delete(key);
    if (this.#isRestoring && this.#visible?.segments.some((facts) => facts.key === key)) this.hideAll();
  }

  // ---- memory

  /** Whether it is shown, or to be shown. */
  #isNeeded(key: SegmentKey): boolean {
    return this.#wanted.has(key) || this.#shown.has(key) || (this.#isRestoring && this.#isVisible(key));
  }

  #isVisible(key: SegmentKey): boolean {
    return this.#visible?.segments.some((facts) => facts.key === key) === true;
  }

  /** The newest plan wants these. Meshes that wait for their upload, and that it does not want, are given up. */
  #want({ show }: PlanFacts): void {
    this.#wanted = new Set(show.map(({ key }) => key));
    this.#freeUnneeded();
  }

  #freeUnneeded(): void {
    for (const [key, ground] of this.#grounds) {
      if (!ground.isWhole && !this.#isNeeded(key)) this.#drop(key, ground);
    }
    this.#trim();
  }

  /** Free what is neither shown nor wanted, least recently used first, until it fits. */
  #trim(): void {
    const spare = [...this.#grounds].filter(([key]) => !this.#isNeeded(key));
    let bytes = spare.reduce((sum, [, ground]) => sum + ground.gpuBytes, 0);
    if (bytes <= this.#options.spareGpuBytes) return;
    spare.sort(([, a], [, b]) => a.usedAtMs - b.usedAtMs);
    for (const [key, ground] of spare) {
      if (bytes <= this.#options.spareGpuBytes) return;
      bytes -= ground.gpuBytes;
      this.#drop(key, ground);
    }
  }

  #drop(key: SegmentKey, ground: SegmentGround): void {
    this.#grounds.delete(key);
    this.#free(ground);
  }

  /** Out of the picture at once, its memory later: drivers take their time to free. */
  #free(ground: SegmentGround): void {
    ground.isShown = false;
    this.#freeing.push(ground);
  }

  /** Forget everything of this version but what is shown. */
  #forget(): void {
    this.#grounds.clear();
    this.#decoding = new Set();
    this.#held = new Set();
    this.#wanted = new Set();
    this.#prefetched = [];
    this.#prefetchedBytes = 0;
  }

  // ---- uploads and sets

  /** What is restored, then what the newest plan wants, most urgent first. */
  get #order(): readonly SegmentKey[] {
    const restored = this.#isRestoring ? (this.#visible?.segments ?? []) : [];
    return [...restored.map(({ key }) => key), ...this.#wanted];
  }

  #notWhole(): SegmentGround[] {
    return [...this.#grounds.values()].filter(({ isWhole }) => !isWhole);
  }

  #nextUpload(): SegmentGround | undefined {
    for (const key of this.#order) {
      const ground = this.#grounds.get(key);
      if (ground?.isWhole === false) return ground;
    }
    return this.#notWhole()[0];
  }

  /** What is uploaded after this one: what the plan says, then what a prefetch brought and is decoded. */
  #comingAfter(ground: SegmentGround): ComingMesh[] {
    const isComing = ({ key }: { readonly key: SegmentKey }): boolean =>
      key !== ground.key && this.#grounds.get(key)?.hasRoom !== true;
    const planned = this.next?.segments.filter(isComing) ?? [];
    const keys = new Set(planned.map(({ key }) => key));
    const others = this.#notWhole().filter((other) => isComing(other) && !keys.has(other.key));
    return [
      ...planned.map(({ vertices, faces }) => ({ vertices, faces })),
      ...others.map(({ vertexCount, faceCount }) => ({ vertices: vertexCount, faces: faceCount })),
    ];
  }

  /** Whether pages may be moved together now: not while something is still to come. */
  get #isUntidy(): boolean {
    return this.#pages.isUntidy && (this.next === null || this.#isComplete(this.next));
  }

  #isComplete({ segments }: ShowableSet): boolean {
    return segments.every(({ key }) => this.isOnGpu(key));
  }

  #show(set: ShowableSet): void {
    for (const facts of set.segments) {
      const ground = this.#grounds.get(facts.key)!;
      ground.facts = facts;
      ground.isShown = true;
      this.#shown.set(facts.key, ground);
    }
    this.#visible = set;
  }

  /** The same landing will show the same: it can be shown again before the service answers. */
  #remember(): void {
    const landing = this.#newest;
    if (!landing?.isRepeatable || landing.plan === null) return;
    const { key, plan } = landing;
    this.#remembered.delete(key);
    const show = plan.show.map((facts) => ({ ...facts, follows: false }));
    this.#remembered.set(key, { ...plan, show, loadBytes: 0 });
    const [oldest] = this.#remembered.keys();
    if (this.#remembered.size > MAX_REMEMBERED && oldest !== undefined) this.#remembered.delete(oldest);
  }
}
