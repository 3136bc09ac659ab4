import { expect, test } from "vitest";
import { groupsByName } from "../src/app/panel/look-tab.ts";
import { parseRoute } from "../src/app/route.ts";
import { readLabels, readRegions } from "../src/core/scene/regions.ts";
import type { SceneManifest } from "../src/core/types.ts";
import { nameColours, regionColour, toCss } from "../src/three/palette.ts";
import { keyOfMode, modeOfKey, modesOf } from "../src/three/view-modes.ts";

const LABELS = readLabels({
  format: "terraport-labels",
  format_version: "1.0",
  labels: [
    { stable_id: 3, label: "stockpile" },
    { stable_id: 4, label: "haul road" },
    { stable_id: 5, label: "stockpile" },
  ],
});
const ROWS = [
  { stable_id: 3, area_m2: 10 },
  { stable_id: 9, area_m2: 500 },
  { stable_id: 5, area_m2: 90 },
  { stable_id: 4, area_m2: 7 },
];
const REGIONS = readRegions({ regions: ROWS.map((row, id) => ({ id, ...row })) }, LABELS);
const MANIFEST = { attributes: [], texturesOf: null, hasColour: true } as unknown as SceneManifest;

test("regions of one name have one colour, whatever their ids; other names have others", () => {
  const colours = nameColours(REGIONS);
  expect([...colours.keys()]).toEqual(["haul road", "stockpile"]);
  expect([...colours.values()].map(toCss)).toEqual([0, 1].map((place) => toCss(regionColour(place))));
  expect([...nameColours(REGIONS.toReversed())]).toEqual([...colours]);
});

test("the legend adds regions up by name, the largest first, what has none last", () => {
  expect(groupsByName(REGIONS)).toEqual([
    { name: "stockpile", count: 2, areaM2: 100 },
    { name: "haul road", count: 1, areaM2: 7 },
    { name: null, count: 1, areaM2: 500 },
  ]);
});

test("names are a way to colour the ground where there are any, in links too", () => {
  const keys = (regions: typeof REGIONS) => modesOf(MANIFEST, regions).map(({ mode }) => keyOfMode(mode));
  expect(keys(REGIONS)).toContain("names");
  expect(keys(REGIONS.filter(({ label }) => label === null))).not.toContain("names");
  expect(modeOfKey("names", MANIFEST, REGIONS)).toEqual({ kind: "names" });
  expect(modeOfKey("names", MANIFEST)).toBeNull();
  expect(parseRoute("#scene=pit&mode=names").mode).toEqual({ kind: "names" });
});
