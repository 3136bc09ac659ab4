/** Pages of segments: what lies where on a device whose memory can be read back, whatever was moved. */

import { type GLBufferAttribute, Group } from "three";
import { afterAll, beforeAll, describe, expect, it, vi } from "vitest";
import { gpuBytesOf, MAX_PAGE_VERTICES, pageBytes } from "../../src/core/gpu-budget.ts";
import type { CompressedImage, MeshData, SceneManifest } from "../../src/core/types.ts";
import { GpuStore } from "../../src/three/gpu-store.ts";
import { GroundMaterial } from "../../src/three/ground-material.ts";
import { vertexParts } from "../../src/three/mesh-room.ts";
import { MeshUpload } from "../../src/three/mesh-upload.ts";
import type { PageRange } from "../../src/three/page.ts";
import { type ComingMesh, Pages } from "../../src/three/pages.ts";
import { random as seeded } from "../random.ts";
import { type FakeBuffer, FakeContext, type FakeImages, fakeRenderer } from "../versions/fake-gpu.ts";

const VERTEX_BYTES = 12;
/** Of a form that is only read. */
const COMPRESSED = { form: 0x8e8d, extension: "EXT_texture_compression_bptc" };
const DRAWABLE = { form: 0x8c43, extension: null };

beforeAll(() => vi.stubGlobal("WebGL2RenderingContext", FakeContext));
afterAll(() => vi.unstubAllGlobals());

function imageOf(id: number, kind: typeof COMPRESSED | typeof DRAWABLE): CompressedImage {
  return { width: 8, height: 4, ...kind, levels: [16, 8, 4, 2].map((size) => new Uint8Array(size).fill(id % 251)) };
}

/** A mesh and its number. */
type TestMesh = MeshData & { readonly id: number };

function meshOf(id: number, vertexCount: number, image: CompressedImage | null = null): TestMesh {
  const faceCount = 2 * vertexCount;
  const codes = Uint16Array.from({ length: 4 * vertexCount }, (_, at) => (at * 7919 + id * 104_729) % 65_536);
  return {
    id,
    vertexCount,
    faceCount,
    translation: [id, 0, 0],
    stepM: 0.5,
    positions: codes,
    normals: Int8Array.from(codes),
    colours: null,
    uvs: null,
    uvScale: [1, 1],
    regionIds: null,
    attributes: [],
    indices: Uint16Array.from({ length: 3 * faceCount }, (_, at) => (at * 31 + id) % vertexCount),
    image: image && { width: image.width, height: image.height, pixels: image },
    bounds: [0, 0, 0, 1, 1, 1],
  } as unknown as TestMesh;
}

/** Pages, and what was put into them. */
class Shelf {
  readonly store = new GpuStore(fakeRenderer());
  readonly group = new Group();
  readonly ranges = new Map<number, readonly [TestMesh, PageRange]>();
  readonly pages: Pages;
  mostBytes = 0;
  /** Ids name other payloads than those that are here. */
  hasLeft = false;

  constructor(maxBytes = Number.POSITIVE_INFINITY) {
    const material = new GroundMaterial({ stepM: 2 ** -12, textures: null } as unknown as SceneManifest, []);
    const again = async (id: string) => {
      const image = this.ranges.get(Number(id))?.[0].image ?? null;
      return this.hasLeft && image ? { ...image, pixels: imageOf(Number(id) + 1, COMPRESSED) } : image;
    };
    this.pages = new Pages(this.group, this.store, material, maxBytes, again);
  }

  /** False where pages had to be moved, and a step of it was done. */
  async put(data: TestMesh, coming: readonly ComingMesh[] = []): Promise<boolean> {
    const parts = vertexParts(data);
    const range = this.pages.reserve(String(data.id), data, parts, () => coming);
    this.#note();
    if (range === null) {
      await this.tidy();
      return false;
    }
    const { room, images } = range.page;
    const { firstVertex, firstIndex, layer } = range;
    const upload = new MeshUpload(this.store, { room, firstVertex, firstIndex, images, layer }, data, parts, false);
    while (!upload.isDone) upload.step();
    range.isShown = true;
    this.pages.completed(range);
    this.ranges.set(data.id, [data, range]);
    return true;
  }

  free(id: number): void {
    this.pages.release(this.ranges.get(id)![1]);
    this.ranges.delete(id);
  }

  /** One step, and time for an image to be decoded. */
  async tidy(): Promise<void> {
    this.pages.tidy();
    this.#note();
    await Promise.resolve();
    await Promise.resolve();
  }

  async settle(): Promise<void> {
    for (let step = 0; step < 5000 && this.pages.isUntidy; step += 1) await this.tidy();
    expect(this.pages.isUntidy).toBe(false);
  }

  get liveBytes(): number {
    return [...this.ranges.values()].reduce((sum, [data]) => sum + gpuBytesOf(data), 0);
  }

  get bytes(): number {
    return this.store.bufferBytes + this.store.textureBytes;
  }

  /** Everything that was put here and not freed lies on the device as it was, and is drawn from there. */
  check(): void {
    for (const [id, [data, range]] of this.ranges) {
      const { room, images, ranges, mesh } = range.page;
      expect(ranges.has(range) && mesh.visible && mesh.parent === this.group).toBe(true);
      const codes = new Uint16Array(bytesOf(room.attributes.get("code")!).buffer);
      expect(sameValues(codes.subarray(4 * range.firstVertex), data.positions)).toBe(true);
      const indices = new Uint16Array(bytesOf(room.index!).buffer).subarray(range.firstIndex);
      expect(
        sameValues(
          indices.subarray(0, data.indices.length).map((at) => at - range.firstVertex),
          data.indices,
        ),
      ).toBe(true);
      expect(range.traits[0]).toBe(id);
      if (images === null || data.image === null) continue;
      const { written } = images.texture as unknown as FakeImages;
      (data.image.pixels as CompressedImage).levels.forEach((level, at) => {
        expect(written.get(`${range.layer} ${at}`)).toEqual(level);
      });
    }
  }

  #note(): void {
    this.mostBytes = Math.max(this.mostBytes, this.bytes);
  }
}

function bytesOf({ buffer }: GLBufferAttribute): Uint8Array<ArrayBuffer> {
  return (buffer as unknown as FakeBuffer).bytes as Uint8Array<ArrayBuffer>;
}

function sameValues(a: ArrayLike<number>, b: ArrayLike<number>): boolean {
  for (let at = 0; at < b.length; at += 1) if (a[at] !== b[at]) return false;
  return true;
}

describe("pages", () => {
  it("are as large as what a landing brings, and no index is the one that ends a strip", async () => {
    const shelf = new Shelf();
    const sizes = [30_000, 30_000, 5_535, 20_000];
    const coming = sizes.map((vertices) => ({ vertices, faces: 2 * vertices }));
    for (const [id, vertices] of sizes.entries()) await shelf.put(meshOf(id, vertices), coming.slice(id + 1));
    shelf.check();
    expect(shelf.pages.count).toBe(2);
    expect(shelf.bytes).toBe(shelf.liveBytes);
    const [, range] = shelf.ranges.get(2)!;
    expect(range.firstVertex + range.vertexCount).toBe(MAX_PAGE_VERTICES);
    expect(bytesOf(range.page.room.index!).length).toBe(2 * 6 * MAX_PAGE_VERTICES);
    expect(Math.max(...new Uint16Array(bytesOf(range.page.room.index!).buffer).subarray(range.firstIndex))).toBe(
      65_534,
    );
  });

  it.each([
    ["without images", null],
    ["with images that a GPU copies", DRAWABLE],
    ["with images that it only reads", COMPRESSED],
  ])("%s hold what they were given on a walk of landings, in at most twice its room", async (_name, kind) => {
    const random = seeded(7);
    const shelf = new Shelf();
    let next = 0;
    for (let landing = 0; landing < 30; landing += 1) {
      const news = Array.from({ length: 1 + Math.floor(random() * 40) }, () => {
        const id = next;
        next += 1;
        return meshOf(id, 3 + Math.floor(random() * 40), kind && imageOf(id, kind));
      });
      for (const [at, data] of news.entries()) {
        const coming = news
          .slice(at + 1)
          .map(({ vertexCount, faceCount }) => ({ vertices: vertexCount, faces: faceCount }));
        await shelf.put(data, random() < 0.8 ? coming : []);
      }
      for (const id of [...shelf.ranges.keys()]) if (random() < 0.4) shelf.free(id);
      // Something leaves while it is moved.
      for (let step = 0; step < 5; step += 1) await shelf.tidy();
      for (const id of [...shelf.ranges.keys()]) if (random() < 0.1) shelf.free(id);
      await shelf.settle();
      shelf.check();
      expect(shelf.bytes).toBeLessThanOrEqual(2 * shelf.liveBytes);
      expect(shelf.pages.count).toBeLessThanOrEqual(12);
    }
    for (const id of [...shelf.ranges.keys()]) shelf.free(id);
    await shelf.settle();
    expect([shelf.bytes, shelf.pages.count, shelf.group.children.length]).toEqual([0, 0, 0]);
  });

  it("take no more than they may, though nothing is half empty", async () => {
    const random = seeded(3);
    // What lives may be 2.5 MB at most, and a page is moved beside it.
    const mostLive = 2_500_000;
    const maxBytes = mostLive + pageBytes(VERTEX_BYTES);
    const shelf = new Shelf(maxBytes);
    let moves = 0;
    const meshes = Array.from({ length: 160 }, (_, id) => meshOf(id, 500 + Math.floor(random() * 1500)));
    const sizes = meshes.map(({ vertexCount, faceCount }) => ({ vertices: vertexCount, faces: faceCount }));
    for (const [at, data] of meshes.entries()) {
      const ids = [...shelf.ranges.keys()];
      while (shelf.liveBytes + gpuBytesOf(data) > mostLive) {
        shelf.free(ids.splice(Math.floor(random() * ids.length), 1)[0]!);
      }
      while (!(await shelf.put(data, sizes.slice(at + 1, at + 12)))) moves += 1;
    }
    shelf.check();
    expect(moves).toBeGreaterThan(0);
    expect(shelf.mostBytes).toBeLessThanOrEqual(maxBytes);
  });

  it("of a segment each, as aims leave them, become few, each copied a few times", async () => {
    const shelf = new Shelf();
    for (let id = 0; id < 64; id += 1) {
      await shelf.put(meshOf(id, 20 + (id % 7)));
      await shelf.settle();
    }
    shelf.check();
    expect(shelf.pages.count).toBeLessThanOrEqual(6);
    expect(shelf.store.createdBytes).toBeLessThan(8 * shelf.liveBytes);
  });

  it("of a version that was left are not moved: their ids name other payloads", async () => {
    const shelf = new Shelf();
    const meshes = Array.from({ length: 8 }, (_, id) => meshOf(id, 10, imageOf(id, COMPRESSED)));
    const coming = meshes.map(({ vertexCount, faceCount }) => ({ vertices: vertexCount, faces: faceCount }));
    for (const [at, data] of meshes.entries()) await shelf.put(data, coming.slice(at + 1));
    for (let id = 0; id < 6; id += 1) shelf.free(id);
    shelf.pages.leaveVersion();
    shelf.hasLeft = true;
    await shelf.settle();
    shelf.check();
    expect(shelf.pages.count).toBe(1);
  });
});
