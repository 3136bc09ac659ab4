import { expect, test } from "vitest";
import { regionsToVisit } from "../src/app/region-places.ts";
import { parseRoute } from "../src/app/route.ts";
import { readLabels, readRegions } from "../src/core/scene/regions.ts";

const LABELS = readLabels({
  format: "terraport-labels",
  format_version: "1.0",
  labels: [
    { stable_id: 3, label: "stockpile" },
    { stable_id: 4, label: "haul road" },
    { stable_id: 5, label: "stockpile" },
  ],
});

function regions(rows: object[]) {
  return readRegions({ regions: rows.map((row, id) => ({ id, ...row })) }, LABELS);
}

test("named regions by name, the largest first, each with the address of its best view", () => {
  const place = { position: [1, 2, -3], heading_deg: 270, radius_m: 25 };
  const visits = regionsToVisit(
    "pit",
    regions([
      { stable_id: 3, area_m2: 10, centroid: [0, 0, 0], place },
      { stable_id: 5, area_m2: 90, centroid: [7, 8, 9] },
      { stable_id: 4, area_m2: 1, centroid: [4, 5, 6], place: { position: "no", heading_deg: 1, radius_m: 2 } },
      { stable_id: 9, area_m2: 500, centroid: [0, 0, 0] },
    ]),
    10,
  );
  expect(visits.map(({ name, areaM2 }) => [name, areaM2])).toEqual([
    ["haul road", 1],
    ["stockpile", 90],
    ["stockpile", 10],
  ]);
  const best = parseRoute(visits[2]!.hash);
  expect(best.scene).toBe("pit");
  expect(best.place).toMatchObject({ at: [1, 2, -3], radiusM: 25, view: "walk", yawDeg: 270 });
  // Nobody chose: its middle, looked at as before. A place that is none counts as none.
  expect(parseRoute(visits[1]!.hash).place).toMatchObject({ at: [7, 8, 9], radiusM: null, view: null, yawDeg: null });
  expect(parseRoute(visits[0]!.hash).place).toMatchObject({ at: [4, 5, 6], view: null });
});

test("a region without a name or a middle is no place, and the list has an end", () => {
  const rows = regions([{ stable_id: 3 }, { centroid: [1, 1, 1] }, { stable_id: 4, centroid: [1, 1, 1] }]);
  expect(regionsToVisit("pit", rows, 10).map(({ name }) => name)).toEqual(["haul road"]);
  expect(regionsToVisit("pit", rows, 0)).toEqual([]);
});
