/**
 * Landings of a terrain in whatever order events, decoded meshes and frames come: what is drawn changes in a swap alone, to
 * exactly what the stream declared, on a device whose memory can be read back.
 */

import { afterAll, beforeAll, describe, expect, it, vi } from "vitest";
import type { MeshData, PlanFacts, SceneFiles, SegmentFacts, SegmentKey, Stream } from "../../src/core/types.ts";
import { hasFace } from "../../src/three/face-set.ts";
import { Terrain } from "../../src/three/terrain.ts";
import { random as seeded } from "../random.ts";
import { drawnMeshes, FakeContext, fakeRenderer } from "../versions/fake-gpu.ts";

const SEGMENTS = 24;
const BASE_FACES = 5000;
const VERSION = "v-1";

beforeAll(() => vi.stubGlobal("WebGL2RenderingContext", FakeContext));
afterAll(() => vi.unstubAllGlobals());

const keyOf = (segment: number): SegmentKey => segment.toString(16).padStart(16, "0") as SegmentKey;

function factsOf(segment: number, follows: boolean): SegmentFacts {
  return { key: keyOf(segment), segment, isCoarser: false, bytes: 10, faces: 1, vertices: 3, follows };
}

/** Face `f` of the base is under segment `f % SEGMENTS`. */
function hiddenUnder(segments: readonly number[]): Uint8Array<ArrayBuffer> {
  const bits = new Uint8Array(Math.ceil(BASE_FACES / 8));
  for (let face = 0; face < BASE_FACES; face += 1) {
    if (segments.includes(face % SEGMENTS)) bits[face >> 3]! |= 1 << (face & 7);
  }
  return bits;
}

/** Faces of one shape; the first code says what it is. */
function meshOf(code: number, faceCount: number): MeshData {
  return {
    vertexCount: 3,
    faceCount,
    translation: [0, 0, 0],
    stepM: 1,
    positions: Uint16Array.of(code, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0),
    normals: new Int8Array(12),
    colours: null,
    uvs: null,
    uvScale: [1, 1],
    regionIds: null,
    attributes: [],
    indices: Uint16Array.from({ length: 3 * faceCount }, (_, at) => at % 3),
    image: null,
    bounds: [0, 0, 0, 1, 1, 1],
  };
}

const FILES = {
  manifest: {
    id: "walk",
    version: VERSION,
    segmentCount: SEGMENTS,
    levels: 1,
    bounds: [0, 0, 0, 1, 1, 1],
    stepM: 1,
    deviationM: 0,
    attributes: [],
    detailFaces: SEGMENTS,
    texturesOf: null,
  },
  base: meshOf(60_000, BASE_FACES),
  regions: [],
} as unknown as SceneFiles;

/** A terrain with a stream that the test plays. */
class Walk {
  readonly renderer = fakeRenderer();
  readonly terrain: Terrain;
  /** Meshes that are being decoded: `resolve` or `reject`. */
  readonly decoding: { readonly segment: number; readonly settle: (works: boolean) => void }[] = [];
  readonly decodes: number[] = [];
  #landings = 0;

  constructor() {
    const stream = {
      land: () => {
        this.#landings += 1;
        return this.#landings;
      },
      mesh: (key: SegmentKey) =>
        new Promise<MeshData>((resolve, reject) => {
          const segment = Number.parseInt(key, 16);
          this.decodes.push(segment);
          const settle = (works: boolean) => (works ? resolve(meshOf(segment, 1)) : reject(new Error("damaged")));
          this.decoding.push({ segment, settle });
        }),
      stats: () => new Promise(() => undefined),
    } as unknown as Stream;
    this.terrain = new Terrain({ renderer: this.renderer, stream, files: FILES, uploadBudgetMs: 1e6, autoSwap: false });
    this.terrain.handle({ type: "opened", sceneVersion: VERSION, session: "s", changed: false, maxRadiusM: 100 });
  }

  land(x: number): number {
    void this.terrain.land([x, 0, 0], 10);
    return this.terrain.status.landing;
  }

  plan(landing: number, segments: readonly number[], follows: (segment: number) => boolean): void {
    const plan: PlanFacts = {
      landing,
      position: [0, 0, 0],
      radiusM: 10,
      effectiveRadiusM: 10,
      coarseRadiusM: null,
      show: segments.map((segment) => factsOf(segment, follows(segment))),
      hidden: hiddenUnder(segments),
      loadBytes: 0,
      totalBytes: 0,
      totalTriangles: 0,
      omittedSegments: 0,
      omittedBy: null,
    };
    this.terrain.handle({ type: "planned", plan });
  }

  arrive(landing: number | null, segment: number): void {
    const bounds = [0, 0, 0, 1, 1, 1] as const;
    this.terrain.handle({ type: "arrived", landing, key: keyOf(segment), bytes: 10, bounds });
  }

  ready(landing: number, segments: readonly number[], missing: readonly number[] = []): void {
    this.terrain.handle({
      type: "ready",
      landing,
      visible: segments.map(keyOf),
      hidden: hiddenUnder(segments),
      missing: missing.map(keyOf),
      elapsedMs: 1,
      readyAtMs: 1,
      payloadBytes: 1,
    });
  }

  async settle(at: number, works = true): Promise<void> {
    this.decoding.splice(at, 1)[0]?.settle(works);
    await new Promise(setImmediate);
  }

  /** Decode everything, and draw until nothing is left to do. */
  async finish(): Promise<void> {
    for (let frame = 0; frame < 40; frame += 1) {
      while (this.decoding.length > 0) await this.settle(0);
      this.terrain.update();
      drawnMeshes(this.terrain);
    }
  }

  lose(isLost: boolean): void {
    this.renderer.domElement.dispatchEvent(new Event(isLost ? "webglcontextlost" : "webglcontextrestored"));
  }

  /** Segments that are drawn, and whether the base is drawn without exactly the faces under `under`. */
  drawn(): { segments: number[]; hides: (under: readonly number[]) => boolean } {
    const meshes = drawnMeshes(this.terrain);
    const segments = meshes.filter(({ name }) => name === "page").map(({ positions }) => positions[0]!);
    const base = meshes.find(({ name }) => name === "base");
    return {
      segments: segments.sort((a, b) => a - b),
      hides: (under) => {
        const hidden = hiddenUnder(under);
        const faces = Array.from({ length: BASE_FACES }, (_, face) => face).filter((face) => !hasFace(hidden, face));
        return base !== undefined && base.faces.length === faces.length && faces.every((f, at) => f === base.faces[at]);
      },
    };
  }
}

/** A walk with the base on the device. */
async function begun(): Promise<Walk> {
  const walk = new Walk();
  await new Promise(setImmediate); // The shader is compiled.
  await walk.finish();
  return walk;
}

/** A landing from its call to its swap. */
async function landed(walk: Walk, x: number, segments: readonly number[], follows = true): Promise<void> {
  const landing = walk.land(x);
  walk.plan(landing, segments, () => follows);
  if (follows) for (const segment of segments) walk.arrive(landing, segment);
  walk.ready(landing, segments);
  await walk.finish();
  walk.terrain.swap();
}

describe("a landing", () => {
  it("is shown whole, with the base faces below it hidden, in one swap", async () => {
    const walk = await begun();
    const landing = walk.land(0);
    walk.plan(landing, [3, 4], () => true);
    walk.arrive(landing, 3);
    await walk.finish();
    expect(walk.terrain.swap()).toBeNull();
    walk.arrive(landing, 4);
    walk.ready(landing, [3, 4]);
    await walk.finish();
    expect(walk.terrain.status.phase).toBe("presentable");
    expect(walk.drawn().segments).toEqual([]);
    expect(walk.terrain.swap()?.shown).toEqual([keyOf(3), keyOf(4)]);
    expect(walk.drawn().segments).toEqual([3, 4]);
    expect(walk.drawn().hides([3, 4])).toBe(true);
  });

  it("to a place that was shown is presentable before the service answers, and nothing is decoded", async () => {
    const walk = await begun();
    await landed(walk, 0, [1, 2]);
    await landed(walk, 1, [5]);
    const decodes = walk.decodes.length;
    walk.land(0);
    walk.terrain.update();
    expect(walk.terrain.swap()?.shown).toEqual([keyOf(1), keyOf(2)]);
    expect(walk.drawn().hides([1, 2])).toBe(true);
    expect(walk.decodes).toHaveLength(decodes);
  });

  it("shows its inner part first, and then the rest", async () => {
    const walk = await begun();
    const landing = walk.land(0);
    walk.plan(landing, [1, 2], () => true);
    walk.arrive(landing, 1);
    walk.terrain.handle({ type: "degraded", landing, segments: [keyOf(1)], hidden: hiddenUnder([1]) });
    await walk.finish();
    expect(walk.terrain.swap()?.degraded).toBe(true);
    expect(walk.drawn()).toMatchObject({ segments: [1] });
    walk.arrive(landing, 2);
    walk.ready(landing, [1, 2]);
    await walk.finish();
    expect(walk.terrain.swap()?.degraded).toBe(false);
    expect(walk.drawn().segments).toEqual([1, 2]);
    expect(walk.drawn().hides([1, 2])).toBe(true);
  });

  it("without a missing segment hides the base faces that `ready` names", async () => {
    const walk = await begun();
    const landing = walk.land(0);
    walk.plan(landing, [1, 2], () => true);
    walk.arrive(landing, 1);
    walk.ready(landing, [1], [2]);
    await walk.finish();
    walk.terrain.swap();
    expect(walk.drawn()).toMatchObject({ segments: [1] });
    expect(walk.drawn().hides([1])).toBe(true);
    expect(walk.terrain.status.missing).toEqual([keyOf(2)]);
  });

  it("waits for a segment that could not be decoded until it comes again", async () => {
    const walk = await begun();
    const landing = walk.land(0);
    walk.plan(landing, [1], () => true);
    walk.arrive(landing, 1);
    walk.ready(landing, [1]);
    walk.terrain.update();
    await walk.settle(0, false);
    await walk.finish();
    expect(walk.terrain.swap()).toBeNull();
    walk.plan(landing, [1], () => true);
    walk.arrive(landing, 1);
    walk.ready(landing, [1]);
    await walk.finish();
    expect(walk.terrain.swap()?.shown).toEqual([keyOf(1)]);
  });

  it("is drawn again after a loss of the graphics context, all at once", async () => {
    const walk = await begun();
    await landed(walk, 0, [1, 2]);
    const digest = walk.terrain.visibleDigest();
    walk.lose(true);
    expect(walk.terrain.visibleDigest()).toBe(digest);
    walk.lose(false);
    walk.terrain.update();
    expect(walk.drawn().segments).toEqual([]);
    await walk.finish();
    expect(walk.drawn().segments).toEqual([1, 2]);
    expect(walk.drawn().hides([1, 2])).toBe(true);
    expect(walk.terrain.visibleDigest()).toBe(digest);
  });
});

it("prefetched segments are decoded before the landing, and those that it does not need are given up", async () => {
  const walk = await begun();
  for (const segment of [1, 2, 9]) walk.arrive(null, segment);
  await walk.finish();
  expect(walk.decodes.sort()).toEqual([1, 2, 9]);
  await landed(walk, 0, [1, 2], false);
  expect(walk.decodes).toHaveLength(3);
  expect(walk.drawn().segments).toEqual([1, 2]);
});

it.each(Array.from({ length: 16 }, (_, seed) => seed))(
  "what is drawn changes in a swap alone (seed %i)",
  async (seed) => {
    const next = seeded(seed);
    const random = (count: number): number => Math.floor(next() * count);
    const chance = (share: number): boolean => next() < share;
    const some = (): number[] => Array.from({ length: SEGMENTS }, (_, id) => id).filter(() => chance(0.3));
    const walk = await begun();
    let [landing, declared]: [number, number[]] = [0, []];
    let [planned, shown]: [number[] | null, number[]] = [null, []];
    for (let step = 0; step < 150; step += 1) {
      const act = random(8);
      if (act === 0 && chance(0.4)) {
        landing = walk.land(step);
        planned = null;
      } else if (act === 1 && landing > 0 && planned === null) {
        planned = some();
        walk.plan(landing, planned, () => true);
      } else if (act === 2 && planned !== null) {
        for (const segment of planned) walk.arrive(landing, segment);
        declared = planned;
        walk.ready(landing, planned);
      } else if (act === 3) walk.arrive(null, random(SEGMENTS));
      else if (act === 4) await walk.settle(random(Math.max(1, walk.decoding.length)), chance(0.9));
      else if (act === 5 && chance(0.1)) {
        walk.lose(true);
        walk.lose(false);
        await walk.finish();
      } else if (act === 6) {
        if (walk.terrain.swap() !== null) shown = [...declared];
      } else walk.terrain.update();
      const { segments, hides } = walk.drawn();
      if (segments.length === 0 && shown.length > 0)
        expect(hides([])).toBe(true); // Until it is restored.
      else expect(segments).toEqual(shown);
    }
    await landed(walk, -1, [7, 8, 9]);
    expect(walk.drawn().segments).toEqual([7, 8, 9]);
    expect(walk.drawn().hides([7, 8, 9])).toBe(true);
  },
);
