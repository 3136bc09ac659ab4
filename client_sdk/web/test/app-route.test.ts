/** The address: what is written is read again, and nothing that somebody types breaks it. */

import { describe, expect, test } from "vitest";
import { formatRoute, isSameLanding, type Place, parseRoute, type Route } from "../src/app/route.ts";
import { seeded } from "./seeded.ts";

const PLACE: Place = {
  at: [12.5, -3.25, 40],
  radiusM: 60,
  view: "walk",
  yawDeg: 271.5,
  pitchDeg: -12,
  distanceM: null,
  focus: [13, -3, 41.5],
};

describe("an address", () => {
  test("is what the contract says", () => {
    const route: Route = { scene: "pit", place: { ...PLACE, focus: null }, mode: { kind: "regions" } };
    expect(formatRoute(route)).toBe("#scene=pit&at=12.5,-3.25,40&radius=60&look=271.5,-12&view=walk&mode=regions");
  });

  test.each<Route>([
    { scene: null, place: null, mode: null },
    { scene: "pit & co = #1 ü", place: null, mode: null },
    { scene: "pit", place: PLACE, mode: { kind: "slope" } },
    { scene: "pit", place: { ...PLACE, view: "orbit", distanceM: 120.5 }, mode: { kind: "vertex-colour" } },
    { scene: "pit", place: PLACE, mode: { kind: "attribute", name: "Au, g/t & more", range: [-0.25, 3.5] } },
    { scene: "pit", place: PLACE, mode: { kind: "attribute", name: "grade", range: null } },
  ])("is read as it was written: %j", (route) => {
    expect(parseRoute(formatRoute(route))).toEqual(route);
  });

  test.each([
    ["at=1,2", null],
    ["at=1,2,3,4", null],
    ["at=1,,3", null],
    ["at=1,2,NaN", null],
    ["at=1,2,Infinity", null],
    ["at=1,2,0x10", null],
    ["at=1,2,2e7", null],
    ["at=%zz", null],
  ])("without a place has none: %s", (text, place) => {
    expect(parseRoute(`#scene=pit&${text}`).place).toEqual(place);
  });

  test("leaves out what it cannot use, and keeps the rest", () => {
    const { place, mode } = parseRoute("#scene=pit&at=1,2,3&radius=-5&look=400,-200&view=fly&distance=x&mode=glow");
    expect(place).toEqual({
      at: [1, 2, 3],
      radiusM: null,
      view: null,
      yawDeg: 40,
      pitchDeg: -90,
      distanceM: null,
      focus: null,
    });
    expect(mode).toBeNull();
  });

  test("has no range that is upside down", () => {
    expect(parseRoute("#mode=attribute&attribute=grade&range=3,1").mode).toEqual({
      kind: "attribute",
      name: "grade",
      range: null,
    });
  });

  test("never has a token", () => {
    expect(JSON.stringify(parseRoute("#scene=pit&token=secret"))).not.toContain("secret");
  });

  test("takes any text", () => {
    const chance = seeded(7);
    const pieces = [
      "scene=",
      "at=",
      "radius=",
      "look=",
      "focus=",
      "mode=",
      "attribute",
      "&",
      ",",
      "-",
      ".",
      "1",
      "07",
      "e5",
      "%",
      "ü",
    ];
    for (let round = 0; round < 3000; round += 1) {
      const text = Array.from({ length: chance(24) }, () => pieces[chance(pieces.length)]).join("");
      const written = formatRoute(parseRoute(text));
      expect(formatRoute(parseRoute(written))).toBe(written);
    }
  });
});

test("the same landing looked at otherwise is the same landing", () => {
  expect(isSameLanding(PLACE, { ...PLACE, yawDeg: 3, view: "orbit" })).toBe(true);
  expect(isSameLanding(PLACE, { ...PLACE, radiusM: 61 })).toBe(false);
  expect(isSameLanding(PLACE, { ...PLACE, at: [12.6, -3.25, 40] })).toBe(false);
  expect(isSameLanding(PLACE, null)).toBe(false);
});

test("a look without a landing is kept", () => {
  const look = { view: "orbit", yawDeg: 120.5, pitchDeg: -30, distanceM: 45.25, focus: [1, 2.5, -3] } as const;
  const hash = formatRoute({ scene: "pit", place: null, look, mode: null });
  expect(hash).toBe("#scene=pit&look=120.5,-30&distance=45.25&focus=1,2.5,-3&view=orbit");
  expect(parseRoute(hash)).toEqual({ scene: "pit", place: null, look, mode: null });
});
