/** One segment on the GPU: uploaded in slices into a page, then shown and hidden by a flag. */

import type { AttributeCodes, MeshData, SegmentFacts, SegmentKey } from "../core/types.ts";
import { FaceBoxes } from "./face-boxes.ts";
import type { GpuStore } from "./gpu-store.ts";
import { vertexParts } from "./mesh-room.ts";
import { closeImage, MeshUpload, SLICE_BYTES } from "./mesh-upload.ts";
import type { PageRange } from "./page.ts";
import type { ComingMesh, Pages } from "./pages.ts";

/** A segment. `step` until `isWhole`; `free` once. */
export class SegmentGround {
  /** Of the payload. */
  readonly id: SegmentKey;
  /** Number in the scene, at whichever level; -1 until it was shown. */
  segment = -1;
  isCoarser = false;
  readonly faceCount: number;
  readonly vertexCount: number;
  /** For picking; keeps positions, indices and region ids of the decoded mesh, and nothing else of it. */
  readonly boxes: FaceBoxes;
  readonly bounds: MeshData["bounds"];
  readonly #store: GpuStore;
  readonly #pages: Pages;
  readonly #attributes: readonly Pick<AttributeCodes, "name" | "offset" | "step">[];
  #measureName: string | null;
  /** What is read from; null once it is whole, so that all but picking's may be collected. */
  #data: MeshData | null;
  /** Null until there is room for it. */
  #range: PageRange | null = null;
  #upload: MeshUpload | null = null;

  constructor(store: GpuStore, pages: Pages, id: SegmentKey, data: MeshData, measureName: string | null) {
    this.id = id;
    this.faceCount = data.faceCount;
    this.vertexCount = data.vertexCount;
    this.bounds = data.bounds;
    const { translation, stepM, positions, indices, regionIds, faceCount, bounds } = data;
    this.boxes = new FaceBoxes({ translation, stepM, positions, indices, regionIds, faceCount, bounds });
    this.#attributes = data.attributes.map(({ name, offset, step }) => ({ name, offset, step }));
    this.#measureName = measureName;
    this.#store = store;
    this.#pages = pages;
    this.#data = data;
  }

  /** Whether all of it is on the GPU. */
  get isWhole(): boolean {
    return this.#range?.isWhole === true;
  }

  /** Whether it could be drawn now without any further preparation. */
  get isWarm(): boolean {
    return this.isWhole && this.#range?.page.isWarm === true;
  }

  /** Whether it has room in a page. */
  get hasRoom(): boolean {
    return this.#range !== null;
  }

  get isShown(): boolean {
    return this.#range?.isShown === true;
  }

  /** Of what is whole. */
  set isShown(isShown: boolean) {
    if (this.#range !== null) this.#range.isShown = isShown;
  }

  /** What it is in the scene. */
  set facts({ segment, isCoarser }: SegmentFacts) {
    this.segment = segment;
    this.isCoarser = isCoarser;
    if (this.#range !== null) this.#range.segment = segment;
  }

  /** Washed with colour as long as the material says. */
  set isFresh(isFresh: boolean) {
    if (this.#range !== null) this.#range.isFresh = isFresh;
  }

  /** Find room, then upload one slice a call. Returns its bytes; 0 where pages have to make room before. */
  step(coming: () => readonly ComingMesh[]): number {
    const data = this.#data;
    if (data === null) return 0;
    if (this.#upload === null) {
      const parts = vertexParts(data);
      const range = this.#pages.reserve(this.id, data, parts, coming);
      if (range === null) return 0;
      this.#range = range;
      this.setMeasure(this.#measureName);
      const { firstVertex, firstIndex } = range;
      const { room, images } = range.page;
      const target = { room, firstVertex, firstIndex, images, layer: range.layer };
      this.#upload = new MeshUpload(this.#store, target, data, parts, false);
      return SLICE_BYTES;
    }
    const bytes = this.#upload.step();
    if (this.#upload.isDone && this.#range !== null) {
      this.#data = null;
      this.#pages.completed(this.#range);
    }
    return Math.max(bytes, 1);
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    this.#measureName = name;
    const info = this.#attributes.find((attribute) => attribute.name === name);
    if (this.#range !== null) this.#range.measure = info ? [info.offset, info.step] : null;
  }

  free(): void {
    if (this.#range !== null) this.#pages.release(this.#range);
    if (this.#upload === null) closeImage(this.#data?.image ?? null);
    this.#upload?.free();
    this.#range = null;
    this.#upload = null;
    this.#data = null;
  }
}
