/** The segments of a stage on the GPU: those on their way, those there, those shown, and those on their way out. */

import type { Group } from "three";

import type { Residency } from "../core/residency.ts";
import type { MeshData, SegmentKey } from "../core/types.ts";
import type { GpuStore } from "./gpu-store.ts";
import type { GroundMaterial } from "./ground-material.ts";
import type { ImageOf } from "./page-move.ts";
import { type ComingMesh, Pages } from "./pages.ts";
import { SegmentGround } from "./segment-ground.ts";

/** Segments that are freed, and pages that are drawn for the first time, in one frame. */
const MAX_FRAME_FREES = 8;
const MAX_FRAME_WARMINGS = 8;

/** Carries out what the residency decides. */
export class GroundSet {
  readonly #store: GpuStore;
  readonly #pages: Pages;
  readonly #residency: Residency;
  /** Everything of this scene version on its way to the GPU, or there, by key. */
  readonly #grounds = new Map<SegmentKey, SegmentGround>();
  /** The ones that are shown: of these, or, after a change of version, of the old one. */
  readonly #shown = new Map<SegmentKey, SegmentGround>();
  /** Whole, and in a page that was not drawn yet. */
  #warming: SegmentGround[] = [];
  readonly #freeing: SegmentGround[] = [];
  #measureName: string | null = null;

  /** @param maxBytes Most bytes of the whole store: see {@link Pages}. */
  constructor(
    parent: Group,
    store: GpuStore,
    material: GroundMaterial,
    residency: Residency,
    maxBytes: number,
    imageOf: ImageOf,
  ) {
    this.#store = store;
    this.#pages = new Pages(parent, store, material, maxBytes, imageOf);
    this.#residency = residency;
  }

  /** Segments with memory of their own on the GPU. */
  get count(): number {
    return this.#grounds.size;
  }

  /** Draw calls that all of it would take. */
  get pageCount(): number {
    return this.#pages.count;
  }

  /** What is shown, by key. */
  get shown(): ReadonlyMap<SegmentKey, SegmentGround> {
    return this.#shown;
  }

  /** Whether the next frames have something to do for it. */
  get isBusy(): boolean {
    return this.#warming.length > 0 || this.#freeing.length > 0 || this.#isUntidy;
  }

  get pickingBytes(): number {
    let bytes = 0;
    for (const ground of this.#grounds.values()) {
      bytes += ground.boxes.bytes;
    }
    return bytes;
  }

  /** A decoded mesh that the residency took. */
  add(segment: SegmentKey, data: MeshData): void {
    this.#grounds.set(segment, new SegmentGround(this.#store, this.#pages, segment, data, this.#measureName));
  }

  /** Upload one slice of the most urgent segment, or move one between pages. Returns its bytes, or 0 where this frame can do no more. */
  step(): number {
    const segment = this.#residency.nextUpload();
    const ground = segment === null ? undefined : this.#grounds.get(segment);
    if (!ground) {
      // What is on its way may still fill what looks empty.
      return this.#isUntidy ? this.#pages.tidy() : 0;
    }
    // Each new page is drawn once without a range: too many at a time would make that frame a long one.
    if (ground.isWhole || this.#pages.coldCount >= MAX_FRAME_WARMINGS) {
      return 0;
    }
    const bytes = ground.step(() => this.#comingAfter(ground)) || this.#pages.tidy();
    if (ground.isWhole) {
      this.#residency.uploaded(ground.id);
      if (ground.isWarm) this.#residency.warmed(ground.id);
      else this.#warming.push(ground);
    }
    return bytes;
  }

  /** Whatever was warmed was drawn since the last call. */
  endWarming(): void {
    this.#pages.endWarming();
    for (const ground of this.#warming) {
      this.#residency.warmed(ground.id);
    }
    this.#warming = [];
  }

  /** Take what is to be freed out of the way at once, and give a few of them back to the driver. */
  free(): void {
    for (const segment of this.#residency.takeFreed()) {
      const ground = this.#grounds.get(segment);
      if (ground) {
        this.#grounds.delete(segment);
        this.#warming = this.#warming.filter((warming) => warming !== ground);
        this.#toFree(ground);
      }
    }
    for (const ground of this.#freeing.splice(0, MAX_FRAME_FREES)) {
      ground.free();
    }
  }

  /** Set the flag of one segment. */
  setShown(segment: SegmentKey, isShown: boolean): void {
    // What is to be hidden is looked up among what is shown: after a change of version there may be another one of this key.
    const ground = isShown ? this.#grounds.get(segment) : this.#shown.get(segment);
    if (!ground?.isWhole) {
      return;
    }
    ground.isShown = isShown;
    if (isShown) {
      // Only now is it known for certain: what an aim brought has no number until a plan names it.
      const facts = this.#residency.factsOf(segment);
      if (facts !== undefined) ground.facts = facts;
      this.#shown.set(segment, ground);
    } else {
      this.#shown.delete(segment);
    }
  }

  /** Mark these of what is shown as fresh, and no others. */
  markFresh(segments: ReadonlySet<SegmentKey>): void {
    for (const [segment, ground] of this.#shown) ground.isFresh = segments.has(segment);
  }

  /** What is shown at full detail, by key. */
  get shownAtFullDetail(): ReadonlyMap<SegmentKey, SegmentGround> {
    return new Map([...this.#shown].filter(([, ground]) => !ground.isCoarser));
  }

  /** Faces of what is shown. */
  get shownFaces(): number {
    let faces = 0;
    for (const ground of this.#shown.values()) faces += ground.faceCount;
    return faces;
  }

  /** For every segment, and those to come. */
  setMeasure(name: string | null): void {
    this.#measureName = name;
    this.#pages.setMeasure(name);
    for (const ground of this.#allGrounds()) {
      ground.setMeasure(name);
    }
  }

  /** After a change of what the ground takes part in. */
  dress(): void {
    this.#pages.dress();
  }

  /** What is shown stays drawn, and must not be taken for segments of the new version; the rest goes. */
  leaveVersion(): void {
    for (const [segment, ground] of this.#grounds) {
      if (this.#shown.get(segment) !== ground) {
        this.#toFree(ground);
      }
    }
    this.#pages.leaveVersion();
    this.#grounds.clear();
    this.#warming = [];
  }

  /** The old version's segments are not shown any more. */
  hideAll(): void {
    for (const [segment, ground] of this.#shown) {
      if (this.#grounds.get(segment) !== ground) {
        this.#toFree(ground);
      }
    }
    this.#shown.clear();
  }

  /** Free everything at once: what WebGL lost, or at the end. */
  freeAll(): void {
    for (const ground of this.#allGrounds()) {
      ground.free();
    }
    this.#pages.freeAll();
    this.#grounds.clear();
    this.#shown.clear();
    this.#warming = [];
    this.#freeing.length = 0;
  }

  /** Count and hash (FNV-1a) of the segments that are really drawn. */
  digest(): string {
    const drawn = [...this.#shown].filter(([, ground]) => ground.isShown).map(([segment]) => segment);
    const hash = drawn
      .sort()
      .reduce((sum, key) => Math.imul(sum ^ Number.parseInt(key.slice(8), 16), 0x01000193), 0x811c9dc5);
    return `${drawn.length}:${(hash >>> 0).toString(16)}`;
  }

  /** Whether pages may be moved together now. */
  get #isUntidy(): boolean {
    return this.#pages.isUntidy && !this.#residency.isComing;
  }

  /** What is uploaded after this one: what the plan says, then what aims brought and is decoded. */
  #comingAfter(ground: SegmentGround): ComingMesh[] {
    const coming: ComingMesh[] = [];
    const ids = new Set([ground.id]);
    for (const { segment, facts } of this.#residency.awaited()) {
      if (segment === ground.id || this.#grounds.get(segment)?.hasRoom) continue;
      ids.add(segment);
      coming.push(facts ?? { vertices: ground.vertexCount, faces: ground.faceCount });
    }
    for (const [id, { hasRoom, vertexCount: vertices, faceCount: faces }] of this.#grounds) {
      if (!hasRoom && !ids.has(id)) coming.push({ vertices, faces });
    }
    return coming;
  }

  #allGrounds(): Set<SegmentGround> {
    return new Set([...this.#grounds.values(), ...this.#shown.values(), ...this.#freeing]);
  }

  #toFree(ground: SegmentGround): void {
    // Out of the picture at once, its memory later: drivers take their time to free.
    ground.isShown = false;
    this.#freeing.push(ground);
  }
}
