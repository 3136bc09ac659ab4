/** What became sharp, in numbers: faces, and metres from point to point. */

import { expect, test } from "vitest";
import { gainText } from "../../src/app/viewer/compare.ts";
import type { MeshData } from "../../src/core/types.ts";
import { gainOf, pointSpacingM, underFullDetail } from "../../src/three/gain.ts";

/** Two triangles of a square of 2 m, in steps of half a metre, and a third beside it. */
const BASE = {
  stepM: 0.5,
  positions: Uint16Array.from([0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 4, 0, 4, 0, 4, 0, 8, 0, 0, 0]),
  indices: Uint16Array.from([0, 2, 1, 1, 2, 3, 1, 3, 4]),
} as unknown as MeshData;

test("counts what is hidden, and its area", () => {
  expect(gainOf(BASE, Uint8Array.from([1, 1, 0]), 800)).toEqual({ detailFaces: 800, baseFaces: 2, areaM2: 4 });
});

test("counts of what is hidden only what lies under full detail", () => {
  // Under segment 0; under 0 and 1; under 2, which is not hidden.
  const cover = { offsets: Uint32Array.of(0, 1, 3, 4), segments: Uint32Array.of(0, 0, 1, 2) };
  const under = (...full: number[]) =>
    underFullDetail(Uint8Array.from([1, 1, 0]), cover, (segment) => full.includes(segment));
  expect(under(0, 1)).toEqual(Uint8Array.from([1, 1, 0]));
  expect(under(0)).toEqual(Uint8Array.from([1, 0, 0]));
  expect(under(1)).toEqual(new Uint8Array(3));
});

test("is none where nothing is hidden", () => {
  expect(gainOf(BASE, new Uint8Array(3), 800)).toBeNull();
});

test("says how far points are apart", () => {
  // A grid of 1 m has a point and two triangles in each square.
  expect(pointSpacingM(100, 200)).toBe(1);
  expect(gainText({ detailFaces: 800, baseFaces: 2, areaM2: 4 })).toBe(
    "A point every 10 cm, 2.0 m before: 400 times the triangles.",
  );
});
