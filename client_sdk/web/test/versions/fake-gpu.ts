/** A graphics device that keeps what is written to it: what is drawn can be read back without one. */

import { type GLBufferAttribute, type Group, Mesh, type Object3D, PerspectiveCamera, type WebGLRenderer } from "three";

import { PageMesh } from "../../src/three/page.ts";

/** A buffer with its bytes. */
export interface FakeBuffer {
  bytes: Uint8Array;
}

/** An array of images: what was written to "layer level". */
export interface FakeImages {
  written: Map<string, Uint8Array>;
}

/** As much of a WebGL 2 context as meshes need whose images come with all their levels. */
export class FakeContext {
  readonly ARRAY_BUFFER = 0x8892;
  readonly ELEMENT_ARRAY_BUFFER = 0x8893;
  readonly COPY_READ_BUFFER = 0x8f36;
  readonly COPY_WRITE_BUFFER = 0x8f37;
  readonly VERTEX_ARRAY_BINDING = 0x85b5;
  readonly STATIC_DRAW = 0x88e4;
  readonly TEXTURE_2D_ARRAY = 0x8c1a;
  readonly READ_FRAMEBUFFER = 0x8ca8;
  readonly DRAW_FRAMEBUFFER = 0x8ca9;
  readonly #bound = new Map<number, FakeBuffer | null>();
  readonly #attached = new Map<number, readonly [FakeImages, string]>();
  /** Set by the renderer, as three.js's state does. */
  images: FakeImages | null = null;

  getParameter(): null {
    return null;
  }

  pixelStorei(): void {
    // Images are kept as they are written.
  }

  bindVertexArray(): void {
    // There is only one.
  }

  createBuffer(): FakeBuffer {
    return { bytes: new Uint8Array(0) };
  }

  bindBuffer(target: number, buffer: FakeBuffer | null): void {
    this.#bound.set(target, buffer);
  }

  bufferData(target: number, bytes: number): void {
    this.#bound.get(target)!.bytes = new Uint8Array(bytes);
  }

  bufferSubData(target: number, offset: number, bytes: Uint8Array): void {
    this.#bound.get(target)!.bytes.set(bytes, offset);
  }

  copyBufferSubData(from: number, to: number, fromOffset: number, toOffset: number, bytes: number): void {
    const source = this.#bound.get(from)!.bytes;
    if (fromOffset + bytes > source.length) throw new RangeError(`copies ${fromOffset} + ${bytes} of ${source.length}`);
    this.#bound.get(to)!.bytes.set(source.subarray(fromOffset, fromOffset + bytes), toOffset);
  }

  getExtension(): object {
    return {};
  }

  isEnabled(): boolean {
    return false;
  }

  disable(): void {
    // There is no scissor.
  }

  createTexture(): FakeImages {
    return { written: new Map() };
  }

  texStorage3D(): void {
    // Room is made as it is written.
  }

  texParameteri(): void {
    // Nothing is drawn.
  }

  texSubImage3D(_target: number, level: number, ...rest: unknown[]): void {
    this.images!.written.set(`${rest[2]} ${level}`, (rest[8] as Uint8Array).slice());
  }

  compressedTexSubImage3D(_target: number, level: number, ...rest: unknown[]): void {
    this.images!.written.set(`${rest[2]} ${level}`, (rest[7] as Uint8Array).slice());
  }

  deleteTexture(images: FakeImages): void {
    images.written.clear();
  }

  createFramebuffer(): object {
    return {};
  }

  bindFramebuffer(): void {
    // What is attached counts.
  }

  deleteFramebuffer(): void {
    // Nothing was made.
  }

  framebufferTextureLayer(target: number, _at: number, images: FakeImages, level: number, layer: number): void {
    this.#attached.set(target, [images, `${layer} ${level}`]);
  }

  blitFramebuffer(): void {
    const [from, source] = this.#attached.get(this.READ_FRAMEBUFFER)!;
    const [to, target] = this.#attached.get(this.DRAW_FRAMEBUFFER)!;
    to.written.set(target, from.written.get(source)!.slice());
  }

  deleteBuffer(buffer: FakeBuffer): void {
    // A mesh that is drawn after its memory was given back is noticed.
    buffer.bytes = new Uint8Array(0);
  }
}

/** A renderer over a {@link FakeContext}, which must stand as the global `WebGL2RenderingContext`. */
export function fakeRenderer(): WebGLRenderer {
  const context = new FakeContext();
  const state = {
    bindTexture: (_target: number, images: FakeImages) => {
      context.images = images;
    },
    unbindTexture: () => undefined,
  };
  const properties = new WeakMap<object, object>();
  const renderer = {
    getContext: () => context,
    state,
    properties: {
      get: (of: object): object => {
        const found = properties.get(of) ?? {};
        properties.set(of, found);
        return found;
      },
    },
    xr: { isPresenting: false },
    domElement: new EventTarget(),
    compileAsync: async () => undefined,
  };
  return renderer as unknown as WebGLRenderer;
}

/** A mesh, or a range of a page, as the next frame draws it. */
export interface DrawnMesh {
  readonly name: string;
  /** Names of its vertex attributes, sorted, joined by spaces. */
  readonly attributes: string;
  /** Codes of its positions, as they are on the device. */
  readonly positions: Uint16Array;
  /** Faces by number whose three indices differ. */
  readonly faces: readonly number[];
}

/** What a stage draws in the next frame, to a camera that sees all of it: what is switched on, and has faces to draw. */
export function drawnMeshes(object: Group): DrawnMesh[] {
  const meshes: Object3D[] = [];
  object.traverseVisible((child) => child instanceof Mesh && meshes.push(child));
  return meshes.flatMap((child) => {
    const { name, geometry } = child as Mesh;
    const index = valuesOf(geometry.index as unknown as GLBufferAttribute);
    const positions = Uint16Array.from(valuesOf(geometry.getAttribute("code") as unknown as GLBufferAttribute));
    const attributes = Object.keys(geometry.attributes).sort().join(" ");
    return rangesOf(child as Mesh, index.length).map(([start, count]) => {
      const corners = index.subarray(start, start + count);
      // A page's indices count from its own first vertex.
      const first = child instanceof PageMesh ? Math.min(...corners) : 0;
      const faces: number[] = [];
      for (let face = 0; face < count / 3; face += 1) {
        if (new Set(corners.subarray(face * 3, face * 3 + 3)).size === 3) faces.push(face);
      }
      return { name, attributes, positions: positions.subarray(4 * first), faces };
    });
  });
}

/** Starts and counts of indices. */
function rangesOf(mesh: Mesh, indexCount: number): readonly (readonly [number, number])[] {
  if (!(mesh instanceof PageMesh)) return [[0, indexCount]];
  const camera = new PerspectiveCamera(1, 1, 1, 1e9);
  camera.position.set(0, 1e8, 0);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
  const render = mesh.onBeforeRender as unknown as (renderer: null, scene: null, camera: PerspectiveCamera) => void;
  render.call(mesh, null, null, camera);
  const { elementSize } = mesh.geometry.index as unknown as GLBufferAttribute;
  return Array.from({ length: mesh._multiDrawCount }, (_, range) => [
    mesh._multiDrawStarts[range]! / elementSize,
    mesh._multiDrawCounts[range]!,
  ]);
}

function valuesOf({ buffer, elementSize }: GLBufferAttribute): Uint16Array | Uint32Array {
  const { bytes } = buffer as unknown as FakeBuffer;
  return elementSize === 2 ? new Uint16Array(bytes.buffer) : new Uint32Array(bytes.buffer);
}
