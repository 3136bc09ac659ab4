/** Links and landings that lead out of the scene. */

import { describe, expect, it } from "vitest";
import { outsideNotice } from "../src/app/failures.ts";
import { defaultRadiusM, outsideBy } from "../src/core/landing-defaults.ts";
import type { Bounds } from "../src/core/types.ts";

const BOUNDS: Bounds = [-10, 0, -20, 10, 5, 20];

describe("a place", () => {
  it.each([
    [[0, 2, 0], null],
    [[13, 9, 0], null], // 5 m away, within the radius
    [[110, 2, 0], 100],
    [[0, 2, -120], 100],
    [[0, -100, 0], 100],
    [[641_000, 120, 5_200_000], Math.hypot(640_990, 115, 5_199_980)],
  ] as const)("%j", (position, outsideM) => {
    expect(outsideBy(position, 60, BOUNDS)).toBe(outsideM);
  });

  it("outside is said with how far", () => {
    const { text, remedies } = outsideNotice(940, 60);
    expect(text).toContain("940 m away");
    expect(text).toContain("radius of 60 m");
    expect(remedies).toEqual(["dismiss"]);
  });
});

describe("the radius of a first landing", () => {
  const desk = { radiusM: 60, maxTriangles: 6_000_000 };

  it.each([
    [12, 100_000, 4, "a quarter of the way across a small scene"],
    [36, 366_098, 12, "the same, of the scene that comes along"],
    [1500, 90_000_000, 60, "the device's, in a pit"],
    [400, 160_000_000, 30, "half of what can be drawn, in a dense survey"],
    [0.5, 1000, 1, "never less than a metre"],
  ])("of %d m with %d triangles is %d m: %s", (sideM, detailFaces, radiusM) => {
    expect(defaultRadiusM({ bounds: [0, 0, 0, sideM, 9, sideM], detailFaces }, desk)).toBe(radiusM);
  });
});
