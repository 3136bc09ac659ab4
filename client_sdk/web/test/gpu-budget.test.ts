import { expect, test } from "vitest";

import { budgetsFor } from "../src/core/budgets.ts";
import { gpuBytesOf, pageBytes, sharesOf, textureBytes } from "../src/core/gpu-budget.ts";
import type { MeshData, SceneFiles } from "../src/core/types.ts";

const VERTICES = 1000;
const FACES = 1800;

function meshOf(attributes: number): MeshData {
  return {
    vertexCount: VERTICES,
    faceCount: FACES,
    translation: [0, 0, 0],
    stepM: 1,
    positions: new Uint16Array(4 * VERTICES),
    normals: new Int8Array(4 * VERTICES),
    colours: new Uint16Array(4 * VERTICES),
    uvs: null,
    uvScale: [1, 1],
    regionIds: new Uint16Array(2 * VERTICES),
    attributes: Array.from({ length: attributes }, (_, n) => ({
      name: `a${n}`,
      offset: 0,
      step: 1,
      codes: new Uint16Array(2 * VERTICES),
    })),
    indices: new Uint16Array(3 * FACES),
    image: null,
    bounds: [0, 0, 0, 1, 1, 1],
  };
}

test("a texture's bytes count every level, and whole blocks where it is compressed", () => {
  expect(textureBytes(4, 4)).toBe(84);
  expect(textureBytes(16, 8, 8)).toBe(16 * (8 + 2 + 1 + 1 + 1));
  expect(textureBytes(16, 8, 4)).toBe(8 * (8 + 2 + 1 + 1 + 1));
});

test.each([0, 3])("what a landing is told to take is what its meshes take, with %i attributes", (count) => {
  const mesh = meshOf(count);
  const files = { manifest: { attributes: mesh.attributes }, base: mesh } as unknown as SceneFiles;
  const { budgets, spareGpuBytes } = sharesOf(budgetsFor("headset"), files);
  const { gpuVertexBytes = 0, gpuFaceBytes = 0, maxGpuBytes = 0 } = budgets;
  expect(gpuVertexBytes * VERTICES + gpuFaceBytes * FACES).toBe(gpuBytesOf(mesh));
  // The base with its two further lists, two landings, what is spare, and a page that is moved: all of it, and no more.
  const total = gpuBytesOf(mesh) + 2 * 6 * FACES + 2 * maxGpuBytes + spareGpuBytes + pageBytes(gpuVertexBytes);
  expect(total).toBeLessThanOrEqual(budgetsFor("headset").maxGpuBytes);
  expect(total).toBeGreaterThan(budgetsFor("headset").maxGpuBytes - 2);
});
