/** What a landing adds to the base, in numbers: faces, and metres from point to point. */

import { expect, test } from "vitest";
import { gainText } from "../../src/app/viewer/compare.ts";
import type { MeshData } from "../../src/core/types.ts";
import { gainOf, pointSpacingM } from "../../src/three/gain.ts";

/** Two triangles of a square of 2 m, in steps of half a metre, and a third next to it. */
const BASE = {
  stepM: 0.5,
  translation: [10, 0, 0],
  faceCount: 3,
  positions: Uint16Array.from([0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 4, 0, 4, 0, 4, 0, 8, 0, 0, 0]),
  indices: Uint16Array.from([0, 2, 1, 1, 2, 3, 1, 3, 4]),
} as unknown as MeshData;

/** A segment over the square. */
const SQUARE = { faceCount: 400, bounds: [10, 0, 0, 12, 1, 2] } as const;

test("counts the hidden faces and their area", () => {
  expect(gainOf(BASE, Uint8Array.of(0b011), [SQUARE, SQUARE])).toEqual({
    detailFaces: 800,
    baseFaces: 2,
    areaM2: 4,
  });
});

test("counts only hidden faces under full detail", () => {
  expect(gainOf(BASE, Uint8Array.of(0b111), [SQUARE])).toMatchObject({ detailFaces: 400, baseFaces: 2 });
});

test("is null where nothing is hidden", () => {
  expect(gainOf(BASE, new Uint8Array(1), [SQUARE])).toBeNull();
});

test("says how far points are apart", () => {
  // A grid of 1 m has a point and two triangles in each square.
  expect(pointSpacingM(100, 200)).toBe(1);
  expect(gainText({ detailFaces: 800, baseFaces: 2, areaM2: 4 })).toBe(
    "A point every 10 cm, 2.0 m before: 400 times the triangles.",
  );
});
