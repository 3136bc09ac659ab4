/** One mesh on the GPU: buffers and texture, filled a slice at a time. */

import { type BufferAttribute, BufferGeometry, ExternalTexture, GLBufferAttribute, Sphere, Vector3 } from "three";

import type { CompressedImage, MeshData, MeshImage } from "../core/types.ts";
import type { GpuBuffer, GpuStore, GpuTexture } from "./gpu-store.ts";

/** Bytes of one slice: about 0.1 ms on a desktop, so a frame's budget is kept to within that. */
export const SLICE_BYTES = 131_072;

const BYTE = 0x1400;
const UNSIGNED_SHORT = 0x1403;
const UNSIGNED_INT = 0x1405;
const FLOAT = 0x1406;

type VertexArray = Uint16Array | Float32Array | Int8Array;

/** A vertex attribute of the shader, or the indices. */
interface UploadArray {
  readonly name: string;
  readonly use: "vertices" | "indices";
  readonly array: VertexArray | Uint32Array;
  readonly itemSize: number;
  readonly normalised: boolean;
}

/** Buffers and texture of a mesh. `step` until `isDone`; `free` once. */
export class MeshUpload {
  /** Attributes of the shader by name, without the survey's. */
  readonly attributes = new Map<string, GLBufferAttribute>();
  /** The survey's attributes by their own names. */
  readonly measures = new Map<string, GLBufferAttribute>();
  index: GLBufferAttribute | null = null;
  map: ExternalTexture | null = null;
  readonly #store: GpuStore;
  #image: MeshImage | null;
  readonly #isBase: boolean;
  #arrays: readonly UploadArray[];
  readonly #buffers: GpuBuffer[] = [];
  #texture: GpuTexture | null = null;
  #arrayIndex = 0;
  #offset = 0;
  #row = 0;
  #isDone = false;

  /** @param isBase Its indices are another matter, and its image is kept: there is no asking for it again. */
  constructor(store: GpuStore, data: MeshData, isBase: boolean) {
    this.#store = store;
    this.#image = data.image;
    this.#isBase = isBase;
    this.#arrays = arraysOf(data, !isBase);
  }

  get isDone(): boolean {
    return this.#isDone;
  }

  /** Upload one slice. Returns its bytes; for creating and mips, which cost too, a slice's worth. */
  step(): number {
    const upload = this.#arrays[this.#arrayIndex];
    if (upload) {
      return this.#stepBuffer(upload);
    }
    const image = this.#image;
    if (!image) {
      this.#finish();
      return 0;
    }
    if (!this.#texture) {
      this.#texture = this.#store.createTexture(image);
      return SLICE_BYTES;
    }
    const { pixels } = image;
    if ("levels" in pixels) return this.#stepLevel(this.#texture, pixels);
    if (this.#row < image.height) {
      // Whole rows, as WebGL writes rectangles; one at least, however wide the image is.
      const rows = Math.min(Math.max(Math.floor(SLICE_BYTES / (image.width * 4)), 1), image.height - this.#row);
      this.#store.writeTextureRows(this.#texture, pixels, this.#row, rows);
      this.#row += rows;
      return rows * image.width * 4;
    }
    // At the end, of all rows: levels made before would show those that had not come.
    this.#store.makeMips(this.#texture);
    this.map = new ExternalTexture(this.#texture.texture);
    this.#finish();
    return SLICE_BYTES;
  }

  /** Give everything back. An image that was not uploaded whole is closed too. */
  free(): void {
    for (const buffer of this.#buffers) {
      this.#store.freeBuffer(buffer);
    }
    this.#buffers.length = 0;
    if (this.#texture) {
      this.#store.freeTexture(this.#texture);
      this.#texture = null;
    }
    this.map?.dispose();
    this.#closeImage();
  }

  /** Let go of everything that was read from. */
  #finish(): void {
    this.#isDone = true;
    this.#arrays = [];
    this.#closeImage();
  }

  #closeImage(): void {
    if (!this.#isBase) {
      closeImage(this.#image);
    }
    this.#image = null;
  }

  /** A level at a time, the largest first: 1024 x 1024 compressed is 0.5 MB, less than its rows uncompressed. */
  #stepLevel(texture: GpuTexture, pixels: CompressedImage): number {
    const data = pixels.levels[this.#row]!;
    this.#store.writeTextureLevel(texture, pixels, this.#row);
    this.#row += 1;
    if (this.#row === pixels.levels.length) {
      this.map = new ExternalTexture(texture.texture);
      this.#finish();
    }
    return data.byteLength;
  }

  #stepBuffer(upload: UploadArray): number {
    const bytes = new Uint8Array(upload.array.buffer, upload.array.byteOffset, upload.array.byteLength);
    if (this.#offset === 0) {
      this.#buffers.push(this.#store.createBuffer(bytes.length, upload.use));
    }
    const target = this.#buffers[this.#buffers.length - 1]!;
    const length = Math.min(SLICE_BYTES, bytes.length - this.#offset);
    this.#store.writeBuffer(target, this.#offset, bytes.subarray(this.#offset, this.#offset + length));
    this.#offset += length;
    if (this.#offset >= bytes.length) {
      this.#finishBuffer(upload, target.buffer);
      this.#arrayIndex += 1;
      this.#offset = 0;
    }
    return length;
  }

  #finishBuffer(upload: UploadArray, buffer: WebGLBuffer): void {
    // The array gives type and length only: it is not kept.
    const attribute = wrap(buffer, upload.array, upload.itemSize, upload.normalised);
    if (upload.use === "indices") {
      this.index = attribute;
    } else if (upload.name.startsWith(MEASURE)) {
      this.measures.set(upload.name.slice(MEASURE.length), attribute);
    } else {
      this.attributes.set(upload.name, attribute);
    }
  }
}

/** Give back what an image holds outside the collector's sight. */
export function closeImage(image: MeshImage | null): void {
  if (image && "close" in image.pixels) image.pixels.close();
}

/** A geometry over attributes on the GPU, in the scene's frame: `data.bounds` decides whether it is in view. */
export function geometryOf(upload: MeshUpload, index: GLBufferAttribute, data: MeshData): BufferGeometry {
  const geometry = new BufferGeometry();
  for (const [name, attribute] of upload.attributes) {
    geometry.setAttribute(name, asAttribute(attribute));
  }
  geometry.index = asAttribute(index);
  const [x0, y0, z0, x1, y1, z1] = data.bounds;
  // Else three.js would work it out from positions, which are on the GPU alone.
  geometry.boundingSphere = new Sphere(
    new Vector3((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2),
    Math.hypot(x1 - x0, y1 - y0, z1 - z0) / 2,
  );
  return geometry;
}

/** three.js draws with a buffer of ours wherever it takes an attribute with an array; its types do not say so. */
export function asAttribute(attribute: GLBufferAttribute): BufferAttribute {
  return attribute as unknown as BufferAttribute;
}

/** Attribute over a buffer of ours. */
export function wrap(
  buffer: WebGLBuffer,
  array: VertexArray | Uint32Array,
  itemSize: number,
  normalised: boolean,
): GLBufferAttribute {
  const size = array.BYTES_PER_ELEMENT as 1 | 2 | 4;
  return new GLBufferAttribute(buffer, typeOf(array), itemSize, size, array.length / itemSize, normalised);
}

const MEASURE = "measure:";

function typeOf(array: VertexArray | Uint32Array): GLenum {
  if (array instanceof Int8Array) {
    return BYTE;
  }
  if (array instanceof Uint16Array) {
    return UNSIGNED_SHORT;
  }
  return array instanceof Uint32Array ? UNSIGNED_INT : FLOAT;
}

function arraysOf(data: MeshData, withIndices: boolean): UploadArray[] {
  const uploads: UploadArray[] = [];
  const add = (name: string, array: UploadArray["array"] | null, itemSize: number, normalised: boolean): void => {
    if (array) {
      uploads.push({ name, use: name === "index" ? "indices" : "vertices", array, itemSize, normalised });
    }
  };
  // Rows are multiples of 4 bytes, padding included; the shader reads of them what it needs.
  add("code", data.positions, data.positions instanceof Uint16Array ? 4 : 3, false);
  add("tilt", data.normals, 4, true);
  add("tint", data.colours, 4, true);
  add("spot", data.uvs, 2, false);
  add("region", data.regionIds, 2, false);
  for (const attribute of data.attributes) {
    add(`${MEASURE}${attribute.name}`, attribute.codes, 2, false);
  }
  if (withIndices) {
    add("index", data.indices, 1, false);
  }
  return uploads;
}
