/** The ground along a path, and the files that are made of it. */

import { describe, expect, test } from "vitest";
import { MAX_PLACES, profileAlong, profileCsv, profileDxf } from "../src/app/profile.ts";
import type { Vec3 } from "../src/core/types.ts";

/** A slope that falls to the east, with a gap. */
const slope = (x: number, z: number) => (x > 4 && x < 6 ? null : 10 - x + 0 * z);
const toSurvey = ([x, y, z]: Vec3) => [500_000 + x, 7_000_000 - z, 100 + y] as const;

describe("a profile", () => {
  test("follows the ground, corners included, and is cut by a gap", () => {
    const [first, second, ...more] = profileAlong(
      [
        [0, 99, 0],
        [10, 99, 0],
        [10, 0, 5],
      ],
      slope,
    );
    expect(more).toEqual([]);
    expect(first![0]).toEqual({ distanceM: 0, position: [0, 10, 0] });
    expect(first![first!.length - 1]!.position[0]).toBeLessThanOrEqual(4);
    expect(second![0]!.position[0]).toBeGreaterThanOrEqual(6);
    const corner = second!.find(({ position }) => position[0] === 10);
    expect(corner).toEqual({ distanceM: 10, position: [10, 0, 0] });
    expect(second![second!.length - 1]).toEqual({ distanceM: 15, position: [10, 0, 5] });
  });

  test("looks at a bounded number of places, however long the path", () => {
    let looks = 0;
    const path = Array.from({ length: 200 }, (_, index): Vec3 => [index * 50, 0, (index % 2) * 400]);
    profileAlong(path, () => {
      looks += 1;
      return 0;
    });
    expect(looks).toBeLessThanOrEqual(MAX_PLACES);
    expect(looks).toBeGreaterThan(MAX_PLACES / 2);
  });

  test("of one place, or of none, is empty", () => {
    expect(profileAlong([], slope)).toEqual([]);
    expect(profileAlong([[1, 2, 3]], slope)).toEqual([]);
    expect(
      profileAlong(
        [
          [1, 2, 3],
          [1, 9, 3],
        ],
        slope,
      ),
    ).toEqual([]);
  });

  test("as CSV has the columns of the exported section", () => {
    const profile = profileAlong(
      [
        [0, 0, 0],
        [0.02, 0, 0],
      ],
      slope,
    );
    expect(profileCsv(profile, toSurvey)).toBe(
      "line,distance,easting,northing,height\n" +
        "1,0.0000,500000.0000,7000000.0000,110.0000\n" +
        "1,0.0200,500000.0200,7000000.0000,109.9800\n",
    );
  });

  test("as DXF has a polyline for each piece, where it is and as drawn", () => {
    const drawing = profileDxf(
      profileAlong(
        [
          [0, 0, 0],
          [10, 0, 0],
        ],
        slope,
      ),
      toSurvey,
    ).split("\n");
    expect(drawing.filter((line) => line === "POLYLINE")).toHaveLength(4);
    expect(drawing.filter((line) => line === "SEQEND")).toHaveLength(4);
    expect(drawing.slice(-3)).toEqual(["  0", "EOF", ""]);
  });
});
