/** Accessors out of a GLB's BIN chunk: every count, offset and length is checked before anything is reserved for it. */

import { PayloadError } from "./errors.ts";
import type { Glb } from "./glb-container.ts";
import { MAX_IMAGE_BYTES } from "./image-file.ts";
import type { JsonObject } from "./json-values.ts";
import { expectList, expectObject, expectWhole, optionalObject, pick, shortly } from "./json-values.ts";
import type { Compression } from "./meshopt.ts";
import { decompress } from "./meshopt.ts";

/** glTF's component types. */
export const BYTE = 5120;
export const UNSIGNED_SHORT = 5123;
export const UNSIGNED_INT = 5125;
export const FLOAT = 5126;

const MESHOPT = "EXT_meshopt_compression";
const ITEM_BYTES: ReadonlyMap<unknown, number> = new Map([
  [BYTE, 1],
  [UNSIGNED_SHORT, 2],
  [UNSIGNED_INT, 4],
  [FLOAT, 4],
]);
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3 as const, VEC4: 4 };

/** Vertex codec 0 spends at least 4 bytes a channel per block of up to 256 rows; the index codec a byte a triangle. */
const VERTEX_EXPANSION = 64;
const VERTEX_CODEC = 0xa0;
const INDEX_CODEC = 0xe1;

/** What an accessor must be. */
export interface ExpectedAccessor {
  /** For error texts; also says which filters are allowed. */
  readonly label: string;
  readonly components: readonly number[];
  readonly type: keyof typeof WIDTHS;
}

/** Rows in memory of their own. */
export interface Rows {
  readonly count: number;
  readonly component: number;
  /** Bytes from one row to the next. */
  readonly stride: number;
  readonly bytes: Uint8Array<ArrayBuffer>;
  /** The accessor states that its integers are fractions. */
  readonly normalised: boolean;
}

/** Reads what a GLB's document points to. */
export class AccessorReader {
  readonly #glb: Glb;
  readonly #accessors: readonly unknown[];
  readonly #views: readonly unknown[];

  constructor(glb: Glb) {
    this.#glb = glb;
    this.#accessors = expectList(glb.gltf.accessors, "accessors");
    this.#views = expectList(glb.gltf.bufferViews, "bufferViews");
  }

  /** Rows of a vertex attribute; `stride` is what they are brought to where they are stored wider. */
  vertices(number: unknown, expected: ExpectedAccessor, strideOf: (component: number) => number): Rows {
    const { accessor, view, component, count } = this.#find(number, expected);
    const width = WIDTHS[expected.type] * ITEM_BYTES.get(component)!;
    const stored =
      view.byteStride === undefined ? width : expectWhole(view.byteStride, `byteStride of ${expected.label}`, width);
    if (stored > 16 || stored % 4 !== 0) {
      throw new PayloadError(`byteStride of ${expected.label} is ${stored}, expected 4, 8, 12 or 16`);
    }
    const bytes = this.#rows(view, count, stored, "ATTRIBUTES", expected.label);
    const stride = strideOf(component);
    const normalised = accessor.normalized === true;
    return { count, component, stride, bytes: narrowed(bytes, count, stored, stride), normalised };
  }

  /** Vertex numbers, three a face. */
  indices(number: unknown): Uint16Array<ArrayBuffer> | Uint32Array<ArrayBuffer> {
    const label = "indices";
    const expected = { label, components: [UNSIGNED_SHORT, UNSIGNED_INT], type: "SCALAR" } as const;
    const { view, component, count } = this.#find(number, expected);
    if (count % 3 !== 0) throw new PayloadError(`${count} indices, expected a multiple of 3`);
    const { buffer } = this.#rows(view, count, ITEM_BYTES.get(component)!, "TRIANGLES", label);
    return component === UNSIGNED_SHORT ? new Uint16Array(buffer) : new Uint32Array(buffer);
  }

  /** The bytes of an image file: a view of the payload. */
  image(number: unknown): Uint8Array<ArrayBuffer> {
    const label = "image";
    const view = pick(this.#views, number, `bufferView of ${label}`);
    const length = expectWhole(view.byteLength, `byteLength of ${label}`, 1);
    if (length > MAX_IMAGE_BYTES) {
      throw new PayloadError(`${label} of ${length} bytes, expected at most ${MAX_IMAGE_BYTES}`);
    }
    if (optionalObject(view.extensions, "extensions")[MESHOPT] !== undefined) {
      throw new PayloadError(`${label} is compressed as geometry, expected a file as it is`);
    }
    return this.#slice(view, length, label);
  }

  #find(
    number: unknown,
    expected: ExpectedAccessor,
  ): { accessor: JsonObject; view: JsonObject; component: number; count: number } {
    const { label, components, type } = expected;
    const accessor = pick(this.#accessors, number, `accessor of ${label}`);
    const component = components.find((candidate) => candidate === accessor.componentType);
    if (component === undefined || accessor.type !== type) {
      const actual = `${shortly(accessor.componentType)} ${shortly(accessor.type)}`;
      throw new PayloadError(`${label} is ${actual}, expected ${type} of ${components.join(" or ")}`);
    }
    if ((accessor.byteOffset ?? 0) !== 0 || accessor.sparse !== undefined) {
      throw new PayloadError(`${label} has an offset inside its bufferView or is sparse, expected neither`);
    }
    const count = expectWhole(accessor.count, `count of ${label}`, 1);
    return { accessor, view: pick(this.#views, accessor.bufferView, `bufferView of ${label}`), component, count };
  }

  #rows(
    view: JsonObject,
    count: number,
    stride: number,
    mode: Compression["mode"],
    label: string,
  ): Uint8Array<ArrayBuffer> {
    const length = expectWhole(view.byteLength, `byteLength of ${label}`, 1);
    if (length !== count * stride) {
      throw new PayloadError(`bufferView of ${label} has ${length} bytes, expected ${count} rows of ${stride}`);
    }
    const extensions = optionalObject(view.extensions, "extensions");
    // A copy: the arrays are handed on, the payload stays in the cache.
    if (extensions[MESHOPT] === undefined) return this.#slice(view, length, label).slice();
    return this.#decompressed(expectObject(extensions[MESHOPT], MESHOPT), count, stride, mode, label);
  }

  #decompressed(
    packed: JsonObject,
    count: number,
    stride: number,
    mode: Compression["mode"],
    label: string,
  ): Uint8Array<ArrayBuffer> {
    if (packed.mode !== mode || packed.count !== count || packed.byteStride !== stride) {
      throw new PayloadError(`${label} is compressed otherwise than as ${count} rows of ${stride} in mode ${mode}`);
    }
    const vertex = mode === "ATTRIBUTES";
    const length = expectWhole(packed.byteLength, `compressed bytes of ${label}`, 1);
    const minBytes = vertex ? Math.floor((count * stride) / VERTEX_EXPANSION) : count / 3;
    if (length < minBytes) {
      const text = `${length} compressed bytes for ${count} rows of ${label}, expected at least ${minBytes}`;
      throw new PayloadError(text, this.#glb.binaryOffset);
    }
    const filter = filterOf(packed, label, stride);
    const bytes = this.#slice(packed, length, label);
    const offset = bytes.byteOffset - this.#glb.binary.byteOffset + this.#glb.binaryOffset;
    if (bytes[0] !== (vertex ? VERTEX_CODEC : INDEX_CODEC)) {
      throw new PayloadError(`codec byte ${bytes[0]} of ${label}, expected ${vertex ? "0xa0" : "0xe1"}`, offset);
    }
    try {
      return decompress(bytes, count, stride, { mode, filter });
    } catch {
      throw new PayloadError(`${label} does not decompress`, offset);
    }
  }

  #slice(range: JsonObject, length: number, label: string): Uint8Array<ArrayBuffer> {
    const { binary, binaryOffset } = this.#glb;
    if (range.buffer !== 0) {
      throw new PayloadError(`${label} is in buffer ${shortly(range.buffer)}, expected 0 (the BIN chunk)`);
    }
    const offset = expectWhole(range.byteOffset ?? 0, `byteOffset of ${label}`, 0);
    if (offset > binary.length || length > binary.length - offset) {
      const text = `${label} lies at ${offset} with ${length} bytes, expected within ${binary.length}`;
      throw new PayloadError(text, binaryOffset);
    }
    return binary.subarray(offset, offset + length);
  }
}

function filterOf(packed: JsonObject, label: string, stride: number): Compression["filter"] {
  const name = packed.filter ?? "NONE";
  if (name === "NONE") return name;
  if (name === "OCTAHEDRAL" && label === "NORMAL" && stride === 4) return name;
  if (name === "EXPONENTIAL" && label === "POSITION") return name;
  throw new PayloadError(`filter ${shortly(name)} of ${label}, expected none, or the one for ${label}`);
}

/** Rows of the wanted stride; the same bytes where they have it already, as in everything that we write. */
function narrowed(
  bytes: Uint8Array<ArrayBuffer>,
  count: number,
  stored: number,
  stride: number,
): Uint8Array<ArrayBuffer> {
  if (stored === stride) return bytes;
  const target = new Uint8Array(count * stride);
  for (let row = 0; row < count; row += 1) {
    target.set(bytes.subarray(row * stored, row * stored + Math.min(stored, stride)), row * stride);
  }
  return target;
}
