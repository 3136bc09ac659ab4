import { describe, expect, it } from "vitest";

import {
  boxDistanceM,
  isInView,
  matchingErrorPx,
  refineDistanceM,
  refinedSegments,
} from "../../src/study/screen-error.ts";
import { cell, looking } from "./cells.ts";

const OPTIONS = { baseErrorM: 0.2, maxErrorPx: 10, budgets: {} };

describe("the error on the screen", () => {
  it("has as many pixels as asked at the distance where refining ends", () => {
    expect(refineDistanceM(500, OPTIONS)).toBe(10);
    // A metre at 10 m has 50 pixels of 500: the base is off by .2 of that.
    expect((500 / 10) * OPTIONS.baseErrorM).toBe(OPTIONS.maxErrorPx);
  });

  it("can be chosen so that as much is fine as in a landing", () => {
    const maxErrorPx = matchingErrorPx(500, 0.2, 60);
    expect(refineDistanceM(500, { ...OPTIONS, maxErrorPx })).toBeCloseTo(60, 9);
  });
});

describe("what is drawn finely", () => {
  const cells = [cell(1, 0, -5), cell(2, 0, -3), cell(3, 0, 3), cell(4, 0, -30)];

  it("is in view and near, nearest first", () => {
    expect(refinedSegments(cells, looking(true), OPTIONS)).toEqual([2, 1]);
    expect(refinedSegments(cells, looking(false), OPTIONS)).toEqual([3]);
  });

  it("follows the head's place", () => {
    expect(refinedSegments(cells, looking(true, -25), OPTIONS)).toEqual([4]);
  });

  it("keeps to the budgets, as a plan does: nothing smaller jumps the queue", () => {
    const sized = [cell(1, 0, -2, 100), cell(2, 0, -4, 1000), cell(3, 0, -6, 10)];
    const within = (budgets: object) => refinedSegments(sized, looking(true), { ...OPTIONS, budgets });
    expect(within({ maxTriangles: 500 })).toEqual([1]);
    expect(within({ maxSegments: 2 })).toEqual([1, 2]);
    expect(within({ maxBytes: 2999 })).toEqual([1, 2]);
    expect(within({})).toEqual([1, 2, 3]);
  });
});

describe("boxes", () => {
  it("are in view where a corner is", () => {
    const plane = { normal: [1, 0, 0] as const, offset: -2 };
    expect(isInView([0, 0, 0, 3, 1, 1], [plane])).toBe(true);
    expect(isInView([0, 0, 0, 1, 1, 1], [plane])).toBe(false);
  });

  it("are no distance away from inside", () => {
    expect(boxDistanceM([0.5, 0.5, 0.5], [0, 0, 0, 1, 1, 1])).toBe(0);
    expect(boxDistanceM([4, 5, 0.5], [0, 0, 0, 1, 1, 1])).toBe(5);
  });
});
