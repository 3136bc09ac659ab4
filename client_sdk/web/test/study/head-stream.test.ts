import { Group } from "three";
import { afterAll, beforeAll, describe, expect, it, vi } from "vitest";

import type { MeshData, PlanFacts, SceneManifest, Stream, StreamEvent, Vec3 } from "../../src/core/types.ts";
import { HeadStream } from "../../src/study/head-stream.ts";
import type { PlacedSegment } from "../../src/study/screen-error.ts";
import { GpuStore } from "../../src/three/gpu-store.ts";
import { GroundMaterial } from "../../src/three/ground-material.ts";
import { SegmentSet } from "../../src/three/segment-set.ts";
import { FakeContext, fakeRenderer } from "../versions/fake-gpu.ts";
import { cell, looking } from "./cells.ts";

beforeAll(() => vi.stubGlobal("WebGL2RenderingContext", FakeContext));
afterAll(() => vi.unstubAllGlobals());

const TRIANGLE: MeshData = {
  vertexCount: 3,
  faceCount: 1,
  translation: [0, 0, 0],
  stepM: 1,
  positions: new Uint16Array(12),
  normals: new Int8Array(12),
  colours: null,
  uvs: null,
  uvScale: [1, 1],
  regionIds: null,
  attributes: [],
  indices: Uint16Array.of(0, 1, 2),
  image: null,
  bounds: [0, 0, 0, 1, 1, 1],
};

const OPTIONS = { baseErrorM: 0.2, maxErrorPx: 10, budgets: {} };
const AHEAD = [cell(1, 0, -5), cell(2, 0, -3)];
const BEHIND = [cell(3, 0, 3), cell(4, 0, 5)];

/** A stream that a test speaks for. */
class ToldStream {
  onEvent: (event: StreamEvent) => void = () => undefined;
  readonly landings: Vec3[] = [];
  land(position: Vec3): number {
    this.landings.push(position);
    return this.landings.length;
  }
}

function planOf(landing: number, load: readonly PlacedSegment[]): PlanFacts {
  return {
    landing,
    position: [0, 0, 0],
    radiusM: 10,
    effectiveRadiusM: 10,
    coarseRadiusM: null,
    show: load,
    hidden: Uint8Array.of(1),
    loadBytes: 0,
    totalBytes: 0,
    totalTriangles: 0,
    omittedSegments: 0,
    omittedBy: null,
  };
}

/** The follower over a told stream, and the segments that follow it on a device that keeps what is written to it. */
async function landed(cells: readonly PlacedSegment[]) {
  const told = new ToldStream();
  const stream = new HeadStream(told as unknown as Stream);
  const segments = new SegmentSet({
    parent: new Group(),
    store: new GpuStore(fakeRenderer()),
    material: new GroundMaterial({ stepM: 1, texturesOf: null } as unknown as SceneManifest, []),
    maxGpuBytes: Number.POSITIVE_INFINITY,
    spareGpuBytes: 1e9,
    decode: async () => TRIANGLE,
  });
  stream.onEvent = (event) => segments.handle(event);
  const landing = stream.land([0, 0, 0], 10);
  segments.land(landing, [0, 0, 0], 10, 0, {});
  const settle = async () => {
    for (let frame = 0; frame < 20; frame += 1) {
      segments.update(true);
      await new Promise(setImmediate);
      while (segments.step() > 0);
    }
    const { presentable } = segments;
    return presentable && segments.swap(presentable);
  };
  told.onEvent({ type: "planned", plan: planOf(landing, cells) });
  for (const facts of cells)
    told.onEvent({ type: "arrived", landing, key: facts.key, bytes: facts.bytes, bounds: facts.bounds });
  told.onEvent({
    type: "ready",
    landing,
    visible: cells.map(({ key }) => key),
    hidden: Uint8Array.of(1),
    missing: [],
    elapsedMs: 1,
    readyAtMs: 1,
    payloadBytes: 4000,
  });
  await settle();
  /** Numbers of what is shown, ascending. */
  const visible = () => (segments.visible?.segments ?? []).map(({ segment }) => segment).sort((a, b) => a - b);
  return { told, stream, segments, settle, visible };
}

describe("the baseline", () => {
  it("shows a landing whole, as the product does", async () => {
    expect((await landed([...AHEAD, ...BEHIND])).visible()).toEqual([1, 2, 3, 4]);
  });

  it("changes what is shown when the head turns, and back again", async () => {
    const { stream, settle, visible } = await landed([...AHEAD, ...BEHIND]);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(true);
    expect((await settle())?.hidden).toEqual(["key 3", "key 4"]);
    expect(visible()).toEqual([1, 2]);
    expect(stream.follow(looking(false), visible(), OPTIONS)).toBe(true);
    await settle();
    expect(visible()).toEqual([3, 4]);
  });

  it("declares nothing where the head rests", async () => {
    const { stream, settle, visible } = await landed(AHEAD);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(false);
    expect(await settle()).toBeNull();
  });

  it("keeps what is behind on the GPU", async () => {
    const { stream, segments, settle, visible } = await landed([...AHEAD, ...BEHIND]);
    stream.follow(looking(true), visible(), OPTIONS);
    await settle();
    expect(segments.count).toBe(4);
  });

  it("asks for payload where the eye goes, and shows what comes", async () => {
    const { told, stream, settle, visible } = await landed(AHEAD);
    stream.follow(looking(true, -1), visible(), OPTIONS);
    expect(told.landings).toHaveLength(1);
    stream.follow(looking(true, -8), visible(), OPTIONS);
    expect(told.landings[1]).toEqual([0, 0, -8]);
    await settle();
    const { key, bytes, bounds, ...facts } = cell(9, 0, -12);
    told.onEvent({ type: "planned", plan: planOf(2, [{ key, bytes, bounds, ...facts }]) });
    told.onEvent({ type: "arrived", landing: 2, key, bytes, bounds });
    expect(stream.follow(looking(true, -8), visible(), OPTIONS)).toBe(true);
    await settle();
    expect(visible()).toEqual([9]);
  });

  it("begins so many at once and no more", async () => {
    const many = Array.from({ length: 40 }, (_, index) => cell(100 + index, 0, 2 + index * 0.1));
    const { stream, settle, visible } = await landed([...AHEAD, ...many]);
    stream.follow(looking(true), visible(), OPTIONS);
    await settle();
    stream.follow(looking(false), visible(), OPTIONS);
    await settle();
    expect(visible().length).toBe(16);
    while (stream.follow(looking(false), visible(), OPTIONS)) await settle();
    expect(visible().length).toBe(40);
  });

  it("leaves a landing that is under way alone", async () => {
    const { stream, visible } = await landed([...AHEAD, ...BEHIND]);
    stream.land([50, 0, 0], 10);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(false);
  });
});
