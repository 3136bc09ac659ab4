/** One mesh on its way to the GPU: into a room and a layer of its own or of a page's, a slice at a time. */

import type { CompressedImage, MeshData, MeshImage } from "../core/types.ts";
import type { GpuImages, GpuStore } from "./gpu-store.ts";
import type { IndexArray, MeshRoom, VertexPart } from "./mesh-room.ts";

/** Bytes of one slice: about 0.1 ms on a desktop, so a frame's budget is kept to within that. */
export const SLICE_BYTES = 131_072;

/** Where a mesh goes. */
export interface UploadTarget {
  readonly room: MeshRoom;
  readonly firstVertex: number;
  /** Null: its indices are another matter, as the base's are. */
  readonly firstIndex: number | null;
  /** Where its image goes; null for a mesh without one. */
  readonly images: GpuImages | null;
  readonly layer: number;
}

/** What is written of a mesh. `step` until `isDone`; `free` once. */
export class MeshUpload {
  readonly #store: GpuStore;
  readonly #target: UploadTarget;
  readonly #keepsImage: boolean;
  #image: MeshImage | null;
  #parts: readonly VertexPart[];
  #indices: IndexArray | null;
  #part = 0;
  /** Bytes of the part in hand, or indices, that are written. */
  #written = 0;
  #row = 0;
  #isDone = false;

  /** @param keepsImage For the base: there is no asking for its image again. */
  constructor(
    store: GpuStore,
    target: UploadTarget,
    data: MeshData,
    parts: readonly VertexPart[],
    keepsImage: boolean,
  ) {
    this.#store = store;
    this.#target = target;
    this.#keepsImage = keepsImage;
    this.#image = data.image;
    this.#parts = parts;
    this.#indices = target.firstIndex === null ? null : data.indices;
  }

  get isDone(): boolean {
    return this.#isDone;
  }

  /** Upload one slice. Returns its bytes; for creating and mips, which cost too, a slice's worth. */
  step(): number {
    const part = this.#parts[this.#part];
    if (part) {
      return this.#stepPart(part);
    }
    if (this.#indices !== null) {
      return this.#stepIndices(this.#indices);
    }
    const image = this.#image;
    const { images, layer } = this.#target;
    if (!image || !images) {
      this.#finish();
      return 0;
    }
    const { pixels } = image;
    if ("levels" in pixels) return this.#stepLevel(images, pixels);
    if (this.#row < image.height) {
      // Whole rows, as WebGL writes rectangles; one at least, however wide the image is.
      const rows = Math.min(Math.max(Math.floor(SLICE_BYTES / (image.width * 4)), 1), image.height - this.#row);
      this.#store.writeRows(images, layer, pixels, this.#row, rows);
      this.#row += rows;
      return rows * image.width * 4;
    }
    // At the end, of all rows: levels made before would show those that had not come.
    this.#store.makeLevels(images, layer);
    this.#finish();
    return SLICE_BYTES;
  }

  /** Let go of an image that was not uploaded whole. Where it was going is its owner's. */
  free(): void {
    this.#closeImage();
  }

  /** Let go of everything that was read from. */
  #finish(): void {
    this.#isDone = true;
    this.#parts = [];
    this.#closeImage();
  }

  #closeImage(): void {
    if (!this.#keepsImage) {
      closeImage(this.#image);
    }
    this.#image = null;
  }

  /** A level at a time, the largest first: 1024 x 1024 compressed is 0.5 MB, less than its rows uncompressed. */
  #stepLevel(images: GpuImages, pixels: CompressedImage): number {
    const data = pixels.levels[this.#row]!;
    this.#store.writeLevel(images, this.#target.layer, pixels, this.#row);
    this.#row += 1;
    if (this.#row === pixels.levels.length) this.#finish();
    return data.byteLength;
  }

  #stepPart(part: VertexPart): number {
    const bytes = new Uint8Array(part.array.buffer, part.array.byteOffset, part.array.byteLength);
    const length = Math.min(SLICE_BYTES, bytes.length - this.#written);
    const { room, firstVertex } = this.#target;
    room.write(part, firstVertex, this.#written, bytes.subarray(this.#written, this.#written + length));
    this.#written += length;
    if (this.#written >= bytes.length) {
      this.#part += 1;
      this.#written = 0;
    }
    return length;
  }

  #stepIndices(indices: IndexArray): number {
    const some = indices.subarray(this.#written, this.#written + SLICE_BYTES / indices.BYTES_PER_ELEMENT);
    const { room, firstVertex, firstIndex } = this.#target;
    room.writeIndices(some, firstIndex! + this.#written, firstVertex);
    this.#written += some.length;
    if (this.#written >= indices.length) this.#indices = null;
    return some.byteLength;
  }
}

/** Give back what an image holds outside the collector's sight. */
export function closeImage(image: MeshImage | null): void {
  if (image && "close" in image.pixels) image.pixels.close();
}
