/** Segments of one scene may lack an attribute that others have: they are drawn as ground without a value. */

import { readFileSync } from "node:fs";
import { Group, PerspectiveCamera } from "three";
import { afterAll, beforeAll, describe, expect, it, vi } from "vitest";
import { gpuBytesOf } from "../../src/core/gpu-budget.ts";
import { decodeSegment } from "../../src/core/payload/segment-format.ts";
import type { SceneManifest } from "../../src/core/types.ts";
import { GpuStore } from "../../src/three/gpu-store.ts";
import { GroundMaterial } from "../../src/three/ground-material.ts";
import type { PageMesh } from "../../src/three/page.ts";
import { Pages } from "../../src/three/pages.ts";
import { SegmentGround } from "../../src/three/segment-ground.ts";
import { FakeContext, fakeRenderer } from "./fake-gpu.ts";

const PAYLOADS = new URL("../../../../tests/conformance/scene/payload/", import.meta.url);
const NAME = "height_change_m";
const SCALES = [
  { name: "grade", offset: 0, step: 2.5 / 65534 },
  { name: NAME, offset: -256, step: 2 ** -7 },
];

beforeAll(() => {
  vi.stubGlobal("WebGL2RenderingContext", FakeContext);
});

afterAll(() => vi.unstubAllGlobals());

describe("height_change_m in view", () => {
  it.each([
    ["good-attributes.tsg", true],
    ["good-attribute.tsg", false],
    ["good-plain.tsg", false],
  ])("%s", async (file, hasChange) => {
    const group = new Group();
    const material = new GroundMaterial({ stepM: 2 ** -12, textures: null } as unknown as SceneManifest, []);
    material.setMode({ kind: "attribute", name: NAME, min: -2, max: 2 }, "light");
    const store = new GpuStore(fakeRenderer());
    const pages = new Pages(group, store, material, Number.POSITIVE_INFINITY, async () => null);
    const show = (name: string): void => {
      pages.setMeasure(name);
      ground.setMeasure(name);
    };
    const data = await decodeSegment(new Uint8Array(readFileSync(new URL(file, PAYLOADS))), SCALES);
    const ground = new SegmentGround(store, pages, "key", data, gpuBytesOf(data), NAME, 0);
    for (let step = 0; step < 100 && !ground.isWhole; step += 1) ground.step(() => []);
    ground.isShown = true;
    show(NAME);
    const mesh = group.children[0] as PageMesh;
    expect(mesh.geometry.hasAttribute("measure")).toBe(hasChange);
    expect(drawnUniforms(mesh)).toEqual({ hasMeasure: hasChange, scale: hasChange ? [-256, 2 ** -7] : [0, 0] });
    // To another attribute and back, as a reader of the map does.
    show("grade");
    expect(mesh.geometry.hasAttribute("measure")).toBe(file !== "good-plain.tsg");
    show(NAME);
    expect(mesh.geometry.hasAttribute("measure")).toBe(hasChange);
    ground.free();
    expect(store.bufferBytes).toBe(0);
  });
});

function drawnUniforms(mesh: PageMesh): { hasMeasure: boolean; scale: number[] } {
  const render = mesh.onBeforeRender as unknown as (renderer: null, scene: null, camera: PerspectiveCamera) => void;
  const camera = new PerspectiveCamera(1, 1, 1, 1e9);
  camera.position.set(0, 1e8, 0);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
  render.call(mesh, null, null, camera);
  expect(mesh._multiDrawCount).toBe(1);
  const { uniforms } = mesh.material as unknown as {
    uniforms: { hasMeasure: { value: boolean }; traits: { value: Float32Array } };
  };
  return { hasMeasure: uniforms.hasMeasure.value, scale: [...uniforms.traits.value.subarray(6, 8)] };
}
