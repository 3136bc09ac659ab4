/** Distances, arcs and circles. */

import { describe, expect, test } from "vitest";
import { arcPoints, drapeCircle, levelCircle } from "../src/app/arc.ts";
import { measureLeg, measurePath } from "../src/app/measure.ts";

describe("a leg", () => {
  test("of a 3-4-12 box", () => {
    const leg = measureLeg([1, 2, 3], [4, 14, -1]);
    expect(leg.straightM).toBeCloseTo(13, 12);
    expect(leg.horizontalM).toBeCloseTo(5, 12);
    expect(leg.heightDifferenceM).toBe(12);
    expect(leg.slopeDeg).toBeCloseTo((Math.atan2(12, 5) * 180) / Math.PI, 12);
    // East 3, north 4.
    expect(leg.azimuthDeg).toBeCloseTo((Math.atan2(3, 4) * 180) / Math.PI, 12);
  });

  test.each([
    [[0, 0, -1], 0],
    [[1, 0, 0], 90],
    [[0, 0, 1], 180],
    [[-1, 0, 0], 270],
  ] as const)("towards %j goes by %d degrees of the compass", (to, azimuthDeg) => {
    expect(measureLeg([0, 0, 0], to).azimuthDeg).toBeCloseTo(azimuthDeg, 12);
  });

  test("straight up and nowhere", () => {
    expect(measureLeg([1, 1, 1], [1, 4, 1])).toMatchObject({ slopeDeg: 90, azimuthDeg: null, horizontalM: 0 });
    expect(measureLeg([1, 1, 1], [1, 0, 1]).slopeDeg).toBe(-90);
    expect(measureLeg([1, 1, 1], [1, 1, 1])).toMatchObject({ slopeDeg: 0, azimuthDeg: null, straightM: 0 });
  });
});

describe("a path", () => {
  test("needs two points", () => {
    expect(measurePath([])).toBeNull();
    expect(measurePath([[0, 0, 0]])).toBeNull();
  });

  test("adds its legs up, and knows its ends", () => {
    const path = measurePath([
      [0, 0, 0],
      [3, 4, 0],
      [3, 0, 0],
    ])!;
    expect(path.legs).toHaveLength(2);
    expect(path.straightM).toBeCloseTo(9, 12);
    expect(path.horizontalM).toBeCloseTo(3, 12);
    expect(path.heightDifferenceM).toBe(0);
    expect(path.direct.straightM).toBeCloseTo(3, 12);
  });
});

test("an arc goes from below the eye to the place, and over both", () => {
  const points = arcPoints([0, 1.7, 0], [30, 0, 40], 33, 0.6);
  expect(points).toHaveLength(99);
  expect([...points.slice(0, 3)]).toEqual([0, Math.fround(1.1), 0]);
  expect([...points.slice(96)]).toEqual([30, 0, 40]);
  const heights = Array.from({ length: 33 }, (_, index) => points[index * 3 + 1]!);
  expect(Math.max(...heights)).toBeGreaterThan(5);
  expect(Math.min(...heights)).toBeGreaterThanOrEqual(0);
});

test("a circle lies on the ground, is closed, and keeps its height over nothing", () => {
  const drape = drapeCircle([10, 5, 20], 8, 16, 0.25);
  const probes: number[] = [];
  const ground = (x: number) => {
    probes.push(x);
    return x > 10 ? null : x * 0.5;
  };
  expect([drape.step(ground, 7), drape.step(ground, 7), drape.step(ground, 7)]).toEqual([false, false, true]);
  expect(probes).toHaveLength(16);
  expect(drape.onGround).toBeCloseTo(probes.filter((x) => x <= 10).length / 16, 12);
  const { points } = drape;
  expect([...points.slice(0, 3)]).toEqual([...points.slice(48)]);
  for (let index = 0; index <= 16; index += 1) {
    const [x, y, z] = [points[index * 3]!, points[index * 3 + 1]!, points[index * 3 + 2]!];
    expect(Math.hypot(x - 10, z - 20)).toBeCloseTo(8, 4);
    if (x < 10 - 1e-4) expect(y).toBeCloseTo(x * 0.5 + 0.25, 4);
    expect(Number.isFinite(y)).toBe(true);
  }
});

test("a level circle is level", () => {
  const points = levelCircle([1, 2, 3], 4, 8, 0.5);
  for (let index = 0; index <= 8; index += 1) expect(points[index * 3 + 1]).toBe(2.5);
});
