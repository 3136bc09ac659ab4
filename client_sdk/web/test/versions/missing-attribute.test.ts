/** Segments of one scene may lack an attribute that others have: they are drawn as ground without a value. */

import { readFileSync } from "node:fs";
import { type Mesh, PerspectiveCamera } from "three";
import { afterAll, beforeAll, describe, expect, it, vi } from "vitest";
import { prepareDecoders } from "../../src/core/payload/engines.ts";
import { decodeGlb } from "../../src/core/payload/glb.ts";
import type { SceneManifest } from "../../src/core/types.ts";
import { GpuStore } from "../../src/three/gpu-store.ts";
import { GroundMaterial } from "../../src/three/ground-material.ts";
import { SegmentGround } from "../../src/three/segment-ground.ts";
import { FakeContext, fakeRenderer } from "./fake-gpu.ts";

const PAYLOADS = new URL("../../../../tests/conformance/scene/payload/", import.meta.url);
const NAME = "height_change_m";

beforeAll(async () => {
  vi.stubGlobal("WebGL2RenderingContext", FakeContext);
  await prepareDecoders();
});

afterAll(() => vi.unstubAllGlobals());

describe("height_change_m in view", () => {
  it.each([
    ["good-changed.glb", true],
    ["good-full.glb", false],
    ["good-bare.glb", false],
  ])("%s", async (file, hasChange) => {
    const material = new GroundMaterial({ stepM: 2 ** -12, textures: null } as unknown as SceneManifest, []);
    material.setMode({ kind: "attribute", name: NAME, min: -2, max: 2 }, "light");
    const ground = await uploaded(file, material);
    const mesh = ground.mesh!;
    expect(mesh.geometry.hasAttribute("measure")).toBe(hasChange);
    expect(drawnUniforms(mesh)).toEqual({ hasMeasure: hasChange, scale: hasChange ? [-256, 2 ** -7] : [0, 0] });
    // To another attribute and back, as a reader of the map does.
    ground.setMeasure("grade");
    expect(mesh.geometry.hasAttribute("measure")).toBe(file !== "good-bare.glb");
    ground.setMeasure(NAME);
    expect(mesh.geometry.hasAttribute("measure")).toBe(hasChange);
    ground.free();
  });
});

async function uploaded(file: string, material: GroundMaterial): Promise<SegmentGround> {
  const data = await decodeGlb(new Uint8Array(readFileSync(new URL(file, PAYLOADS))), 3);
  const ground = new SegmentGround(new GpuStore(fakeRenderer()), data.segment, data, material, NAME);
  for (let step = 0; step < 100 && ground.mesh === null; step += 1) ground.step();
  return ground;
}

function drawnUniforms(mesh: Mesh): { hasMeasure: boolean; scale: number[] } {
  const render = mesh.onBeforeRender as unknown as (renderer: null, scene: null, camera: PerspectiveCamera) => void;
  render(null, null, new PerspectiveCamera());
  const { uniforms } = mesh.material as unknown as {
    uniforms: { hasMeasure: { value: boolean }; measureScale: { value: { x: number; y: number } } };
  };
  return {
    hasMeasure: uniforms.hasMeasure.value,
    scale: [uniforms.measureScale.value.x, uniforms.measureScale.value.y],
  };
}
