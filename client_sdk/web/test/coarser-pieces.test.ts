/** Coarser pieces of ground that a region is part of (scene format, section 11.1). */

import { describe, expect, it } from "vitest";
import { coarserPieces, readRegions, readUnions } from "../src/core/scene/regions.ts";

const DOCUMENT = {
  regions: [
    { id: 0, area_m2: 2, label: "field" },
    { id: 1, area_m2: 3 },
    { id: 2, area_m2: 5, label: "meadow" },
    { id: 3, area_m2: 7 },
  ],
  // Two at one cost are one answer.
  unions: [
    [0, 1, 1.5],
    [2, 4, 2],
    [3, 5, 2],
  ],
};
const REGIONS = readRegions(DOCUMENT, new Map());

describe("what a region is part of", () => {
  it("grows from cost to cost", () => {
    const unions = readUnions(DOCUMENT);
    expect(coarserPieces(REGIONS, unions, 1)).toEqual([
      { cost: 1.5, regions: [0, 1], areaM2: 5, label: "field" },
      { cost: 2, regions: [0, 1, 2, 3], areaM2: 17, label: "meadow" },
    ]);
    expect(coarserPieces(REGIONS, unions, 3)).toEqual([
      { cost: 2, regions: [0, 1, 2, 3], areaM2: 17, label: "meadow" },
    ]);
  });

  it("is nothing where the scene says nothing, and ends where it says nonsense", () => {
    expect(readUnions({ regions: [] })).toEqual([]);
    for (const bad of [[0, 9, 2], [1, 0, 2], [0, 0, 2], [0, 1], [0, 1, "2"], null]) {
      expect(readUnions({ ...DOCUMENT, unions: [[0, 1, 1.5], bad, [2, 4, 2]] })).toEqual([[0, 1, 1.5]]);
    }
    expect(coarserPieces(REGIONS, [], 0)).toEqual([]);
  });
});
