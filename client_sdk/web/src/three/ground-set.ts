/** The segments of a stage on the GPU: those on their way, those there, those shown, and those on their way out. */

import type { Group } from "three";

import { mix32 } from "../core/cover.ts";
import type { Residency } from "../core/residency.ts";
import type { MeshData } from "../core/types.ts";
import type { GpuStore } from "./gpu-store.ts";
import type { GroundMaterial } from "./ground-material.ts";
import { SegmentGround } from "./segment-ground.ts";

/** Segments that are freed, or drawn for the first time, in one frame. */
const MAX_FRAME_FREES = 8;
const MAX_FRAME_WARMINGS = 8;

/** Carries out what the residency decides. */
export class GroundSet {
  readonly #parent: Group;
  readonly #store: GpuStore;
  readonly #material: GroundMaterial;
  readonly #residency: Residency;
  /** Everything of this scene version on its way to the GPU, or there, by id. */
  readonly #grounds = new Map<number, SegmentGround>();
  /** The ones that are shown: of these, or, after a change of version, of the old one. */
  readonly #shown = new Map<number, SegmentGround>();
  #warming: SegmentGround[] = [];
  readonly #freeing: SegmentGround[] = [];
  #measureName: string | null = null;

  constructor(parent: Group, store: GpuStore, material: GroundMaterial, residency: Residency) {
    this.#parent = parent;
    this.#store = store;
    this.#material = material;
    this.#residency = residency;
  }

  /** Segments with memory of their own on the GPU. */
  get count(): number {
    return this.#grounds.size;
  }

  /** What is shown, by id. */
  get shown(): ReadonlyMap<number, SegmentGround> {
    return this.#shown;
  }

  /** Whether the next frames have something to do for it. */
  get isBusy(): boolean {
    return this.#warming.length > 0 || this.#freeing.length > 0;
  }

  get pickingBytes(): number {
    let bytes = 0;
    for (const ground of this.#grounds.values()) {
      bytes += ground.boxes.bytes;
    }
    return bytes;
  }

  /** A decoded mesh that the residency took. */
  add(segment: number, data: MeshData): void {
    this.#grounds.set(segment, new SegmentGround(this.#store, segment, data, this.#material, this.#measureName));
  }

  /** Upload one slice of the most urgent segment. Returns its bytes, or 0 where this frame can do no more. */
  step(): number {
    const segment = this.#residency.nextUpload();
    const ground = segment === null ? undefined : this.#grounds.get(segment);
    // Each that is whole is drawn once without a face: too many at a time would make that frame a long one.
    if (!ground || ground.mesh || this.#warming.length >= MAX_FRAME_WARMINGS) {
      return 0;
    }
    const bytes = ground.step();
    if (ground.mesh) {
      this.#parent.add(ground.mesh);
      this.#warming.push(ground);
      this.#residency.uploaded(ground.id);
    }
    return bytes;
  }

  /** Whatever was warmed was drawn since the last call. */
  endWarming(): void {
    for (const ground of this.#warming) {
      ground.endWarming();
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
  setShown(segment: number, isShown: boolean): void {
    // What is to be hidden is looked up among what is shown: after a change of version its id is another segment's.
    const ground = isShown ? this.#grounds.get(segment) : this.#shown.get(segment);
    if (!ground?.mesh) {
      return;
    }
    ground.mesh.visible = isShown;
    if (isShown) {
      this.#shown.set(segment, ground);
    } else {
      this.#shown.delete(segment);
    }
  }

  /** Mark these of what is shown as fresh, and no others. */
  markFresh(segments: ReadonlySet<number>): void {
    for (const [segment, ground] of this.#shown) ground.isFresh = segments.has(segment);
  }

  /** What is shown, and not at a coarser level, by segment. */
  get shownAtFullDetail(): ReadonlyMap<number, SegmentGround> {
    return new Map([...this.#shown].filter(([id, ground]) => id === ground.segment));
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
    for (const ground of this.#allGrounds()) {
      ground.setMeasure(name);
    }
  }

  /** What is shown stays drawn, and must not be taken for segments of the new version; the rest goes. */
  leaveVersion(): void {
    for (const [segment, ground] of this.#grounds) {
      if (this.#shown.get(segment) !== ground) {
        this.#toFree(ground);
      }
    }
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
    this.#grounds.clear();
    this.#shown.clear();
    this.#warming = [];
    this.#freeing.length = 0;
  }

  /** Count and hash of what is really drawn, whatever its order. */
  digest(): string {
    let hash = 0;
    let count = 0;
    for (const [segment, ground] of this.#shown) {
      if (ground.mesh?.visible) {
        hash ^= mix32(segment);
        count += 1;
      }
    }
    return `${count}:${(hash >>> 0).toString(16)}`;
  }

  #allGrounds(): Set<SegmentGround> {
    return new Set([...this.#grounds.values(), ...this.#shown.values(), ...this.#freeing]);
  }

  #toFree(ground: SegmentGround): void {
    // Out of the picture at once, its memory later: drivers take their time to free.
    ground.mesh?.removeFromParent();
    this.#freeing.push(ground);
  }
}
