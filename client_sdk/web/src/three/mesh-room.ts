/** Buffers for the vertices and faces of one mesh, or of several behind each other. */

import { type BufferAttribute, BufferGeometry, GLBufferAttribute, type Mesh, Sphere, Vector3 } from "three";

import type { Bounds, MeshData } from "../core/types.ts";
import type { GpuBuffer, GpuStore } from "./gpu-store.ts";

const BYTE = 0x1400;
const UNSIGNED_SHORT = 0x1403;
const UNSIGNED_INT = 0x1405;
const FLOAT = 0x1406;

export type VertexArray = Uint16Array | Float32Array | Int8Array;
export type IndexArray = Uint16Array | Uint32Array;

/** A vertex attribute of the shader, as a mesh has it. */
export interface VertexPart {
  readonly name: string;
  readonly array: VertexArray;
  readonly itemSize: number;
  readonly normalised: boolean;
}

/** How a room is laid out: meshes of one layout can lie in one room. */
export interface RoomLayout {
  readonly parts: readonly PartLayout[];
  /** Null where the indices lie elsewhere. */
  readonly index: ComponentLayout | null;
  /** Of one vertex. */
  readonly vertexBytes: number;
  /** Equal for equal layouts. */
  readonly key: string;
}

interface ComponentLayout {
  readonly type: GLenum;
  readonly componentBytes: 1 | 2 | 4;
}

interface PartLayout extends ComponentLayout {
  readonly name: string;
  readonly itemSize: number;
  readonly normalised: boolean;
}

/** Before the name of a survey's attribute. */
const MEASURE = "measure:";

/** The vertex attributes of a mesh. Rows are multiples of 4 bytes, padding included; the shader reads of them what it needs. */
export function vertexParts(data: MeshData): readonly VertexPart[] {
  const parts: VertexPart[] = [];
  const add = (name: string, array: VertexArray | null, itemSize: number, normalised: boolean): void => {
    if (array) parts.push({ name, array, itemSize, normalised });
  };
  add("code", data.positions, data.positions instanceof Uint16Array ? 4 : 3, false);
  add("tilt", data.normals, 4, true);
  add("tint", data.colours, 4, true);
  add("spot", data.uvs, 2, false);
  add("region", data.regionIds, 2, false);
  for (const attribute of data.attributes) {
    add(`${MEASURE}${attribute.name}`, attribute.codes, 2, false);
  }
  return parts;
}

/** @param indices Of the mesh; null for a room without any. */
export function layoutOf(vertices: readonly VertexPart[], indices: IndexArray | null): RoomLayout {
  const parts = vertices.map(({ name, array, itemSize, normalised }) => ({
    name,
    itemSize,
    normalised,
    ...componentOf(array),
  }));
  const index = indices && componentOf(indices);
  const vertexBytes = parts.reduce((sum, part) => sum + stride(part), 0);
  const words = parts.map(({ name, type, itemSize }) => `${name} ${type} ${itemSize}`);
  return { parts, index, vertexBytes, key: [...words, index?.type].join("|") };
}

/** Empty buffers, to be written and freed by whoever made them. */
export class MeshRoom {
  readonly layout: RoomLayout;
  /** Attributes of the shader by name, without the survey's. */
  readonly attributes = new Map<string, GLBufferAttribute>();
  /** The survey's attributes by their own names. */
  readonly measures = new Map<string, GLBufferAttribute>();
  /** Null where the indices lie elsewhere. */
  readonly index: GLBufferAttribute | null = null;
  readonly bytes: number;
  readonly #store: GpuStore;
  readonly #buffers = new Map<string, GpuBuffer>();
  readonly #indexBuffer: GpuBuffer | null = null;

  constructor(store: GpuStore, layout: RoomLayout, vertexCount: number, indexCount: number) {
    this.#store = store;
    this.layout = layout;
    this.bytes = roomBytes(layout, vertexCount, indexCount);
    for (const part of layout.parts) {
      const { buffer } = this.#buffers
        .set(part.name, store.createBuffer(stride(part) * vertexCount, "vertices"))
        .get(part.name)!;
      const { type, itemSize, componentBytes, normalised } = part;
      const attribute = new GLBufferAttribute(buffer, type, itemSize, componentBytes, vertexCount, normalised);
      if (part.name.startsWith(MEASURE)) this.measures.set(part.name.slice(MEASURE.length), attribute);
      else this.attributes.set(part.name, attribute);
    }
    if (layout.index !== null) {
      this.#indexBuffer = store.createBuffer(layout.index.componentBytes * indexCount, "indices");
      const { type, componentBytes } = layout.index;
      this.index = new GLBufferAttribute(this.#indexBuffer.buffer, type, 1, componentBytes, indexCount, false);
    }
  }

  /** Write bytes of a part, from `offset` within the vertices that begin at `firstVertex`. */
  write(part: VertexPart, firstVertex: number, offset: number, bytes: Uint8Array): void {
    const stride = part.array.BYTES_PER_ELEMENT * part.itemSize;
    this.#store.writeBuffer(this.#buffers.get(part.name)!, firstVertex * stride + offset, bytes);
  }

  /** Write indices of a mesh, which count from its own first vertex, from index `at` on. */
  writeIndices(indices: IndexArray, at: number, firstVertex: number): void {
    const counted = firstVertex === 0 ? indices : indices.map((index) => index + firstVertex);
    const bytes = new Uint8Array(counted.buffer, counted.byteOffset, counted.byteLength);
    this.#store.writeBuffer(this.#indexBuffer!, at * counted.BYTES_PER_ELEMENT, bytes);
  }

  /** Copy vertices of a room of the same layout, on the GPU. Returns their bytes. */
  copyVertices(from: MeshRoom, fromVertex: number, toVertex: number, count: number): number {
    for (const part of this.layout.parts) {
      const size = stride(part);
      const [source, target] = [from.#buffers.get(part.name)!, this.#buffers.get(part.name)!];
      this.#store.copyBuffer(source, fromVertex * size, target, toVertex * size, count * size);
    }
    return count * this.layout.vertexBytes;
  }

  /** A geometry over these buffers; who draws it says where it is. */
  geometry(index: GLBufferAttribute): BufferGeometry {
    const geometry = new BufferGeometry();
    for (const [name, attribute] of this.attributes) geometry.setAttribute(name, asAttribute(attribute));
    geometry.index = asAttribute(index);
    return geometry;
  }

  free(): void {
    for (const buffer of this.#buffers.values()) this.#store.freeBuffer(buffer);
    this.#buffers.clear();
    if (this.#indexBuffer !== null) this.#store.freeBuffer(this.#indexBuffer);
  }
}

/** What so many vertices and indices take. */
export function roomBytes(layout: RoomLayout, vertexCount: number, indexCount: number): number {
  return layout.vertexBytes * vertexCount + (layout.index?.componentBytes ?? 0) * indexCount;
}

/** About a box: else three.js would work it out from positions, which are on the GPU alone. */
export function sphereOf([x0, y0, z0, x1, y1, z1]: Bounds): Sphere {
  return new Sphere(
    new Vector3((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2),
    Math.hypot(x1 - x0, y1 - y0, z1 - z0) / 2,
  );
}

/** Give a geometry the attribute that the shader reads as `measure`, or take it away. */
export function setMeasure(geometry: BufferGeometry, attribute: GLBufferAttribute | undefined): void {
  if (attribute) {
    geometry.setAttribute("measure", asAttribute(attribute));
  } else {
    geometry.deleteAttribute("measure");
  }
}

/** A mesh at the origin of the ground's frame: it goes where the ground as a whole goes. */
export function stayInFrame(mesh: Mesh): void {
  mesh.matrixAutoUpdate = false;
  // Otherwise it would not get the current transform of the ground.
  mesh.matrixWorldNeedsUpdate = true;
}

/** three.js draws with a buffer of ours wherever it takes an attribute with an array; its types do not say so. */
export function asAttribute(attribute: GLBufferAttribute): BufferAttribute {
  return attribute as unknown as BufferAttribute;
}

/** A list of indices in a buffer of ours. */
export function indexAttribute(buffer: WebGLBuffer, indices: IndexArray): GLBufferAttribute {
  const { type, componentBytes } = componentOf(indices);
  return new GLBufferAttribute(buffer, type, 1, componentBytes, indices.length, false);
}

function stride({ componentBytes, itemSize }: PartLayout): number {
  return componentBytes * itemSize;
}

function componentOf(array: VertexArray | IndexArray): ComponentLayout {
  if (array instanceof Int8Array) return { type: BYTE, componentBytes: 1 };
  if (array instanceof Uint16Array) return { type: UNSIGNED_SHORT, componentBytes: 2 };
  return { type: array instanceof Uint32Array ? UNSIGNED_INT : FLOAT, componentBytes: 4 };
}
