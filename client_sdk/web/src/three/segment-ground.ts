/** One segment on the GPU: uploaded in slices into a page, then shown and hidden by a flag. */

import type { AttributeCodes, MeshData, SegmentFacts, SegmentKey } from "../core/types.ts";
import { FaceBoxes } from "./face-boxes.ts";
import type { GpuStore } from "./gpu-store.ts";
import { vertexParts } from "./mesh-room.ts";
import { closeImage, MeshUpload, SLICE_BYTES } from "./mesh-upload.ts";
import type { PageRange } from "./page.ts";
import type { ComingMesh, Pages } from "./pages.ts";

/** A decoded segment. Call `step` until `isWhole`, and `free` once. */
export class SegmentGround {
  readonly key: SegmentKey;
  readonly faceCount: number;
  readonly vertexCount: number;
  readonly bounds: MeshData["bounds"];
  /** For ray tests: the decoded positions, indices and region ids, and nothing else of the mesh. */
  readonly boxes: FaceBoxes;
  /** Bytes on the GPU, once it is whole. */
  readonly gpuBytes: number;
  /** When it was decoded, or last hidden. */
  usedAtMs: number;
  /** Number in the scene, at whichever level; -1 until it is shown. */
  segment = -1;
  isCoarser = false;
  readonly #store: GpuStore;
  readonly #pages: Pages;
  readonly #attributes: readonly Pick<AttributeCodes, "name" | "offset" | "step">[];
  #measureName: string | null;
  /** What is uploaded; null once all of it is, so that it can be collected. */
  #data: MeshData | null;
  /** Null until there is room for it. */
  #range: PageRange | null = null;
  #upload: MeshUpload | null = null;

  constructor(
    store: GpuStore,
    pages: Pages,
    key: SegmentKey,
    data: MeshData,
    gpuBytes: number,
    measureName: string | null,
    nowMs: number,
  ) {
    this.key = key;
    this.faceCount = data.faceCount;
    this.vertexCount = data.vertexCount;
    this.bounds = data.bounds;
    this.gpuBytes = gpuBytes;
    this.usedAtMs = nowMs;
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

  set isShown(isShown: boolean) {
    if (this.#range !== null) this.#range.isShown = isShown;
  }

  /** Which segment of the scene it is. */
  set facts({ segment, isCoarser }: SegmentFacts) {
    this.segment = segment;
    this.isCoarser = isCoarser;
    if (this.#range !== null) this.#range.segment = segment;
  }

  /** Whether it is tinted as long as the material says. */
  set isFresh(isFresh: boolean) {
    if (this.#range !== null) this.#range.isFresh = isFresh;
  }

  /** Find room, then upload one slice a call. Returns its bytes; 0 where pages have to make room before. */
  step(coming: () => readonly ComingMesh[]): number {
    const data = this.#data;
    if (data === null) return 0;
    if (this.#upload === null) {
      const parts = vertexParts(data);
      const range = this.#pages.reserve(this.key, data, parts, coming);
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
