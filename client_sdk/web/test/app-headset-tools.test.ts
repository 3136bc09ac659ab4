import { expect, test } from "vitest";
import { createStore } from "../src/app/store.ts";
import { headsetTools, markOfPath, markOfPick } from "../src/app/viewer/headset-tools.ts";
import type { Picked, ViewerState } from "../src/app/viewer/state.ts";
import type { RegionFacts, SceneManifest, Vec3 } from "../src/core/types.ts";

const manifest = { origin: [600_000, 5_200_000, 400], surveyUnits: null } as unknown as SceneManifest;
const regions = [{ id: 0, stableId: 7, label: "Haul road" }] as unknown as readonly RegionFacts[];
const picked: Picked = { place: [10, 2, -20], segment: 3, region: 0, answer: null };

test("a pick says at once what the page knows, in the survey's coordinates", () => {
  const { points, lines } = markOfPick(picked, manifest, regions);
  expect(points).toEqual([[10, 2, -20]]);
  expect(lines).toEqual(["Haul road", "East 600010.00", "North 5200020.00", "Height 402.00 m", "Asking the service…"]);
});

test("the service's answer wins: its place, name, slope and attributes", () => {
  const answer = {
    position: [10.5, 2.25, -20],
    normal: [0, 1, 1],
    region: 0,
    segment: 3,
    label: "Ramp",
    attributes: { grade: 0.42 },
  } as unknown as Exclude<Picked["answer"], string | null>;
  const { points, lines } = markOfPick({ ...picked, answer }, manifest, regions);
  expect(points).toEqual([[10.5, 2.25, -20]]);
  expect(lines[0]).toBe("Ramp");
  expect(lines).toContain("Height 402.25 m");
  expect(lines.find((line) => line.startsWith("Slope"))).toMatch(/45/);
  expect(lines.at(-1)).toBe("grade 0.42");
});

test("a path says its length once it has two points", () => {
  expect(markOfPath([])).toBeNull();
  expect(markOfPath([[0, 0, 0]])?.lines).toEqual(["Point at the next place"]);
  const path: Vec3[] = [
    [0, 0, 0],
    [3, 0, 4],
    [3, 2, 4],
  ];
  const mark = markOfPath(path)!;
  expect(mark.points).toEqual(path);
  expect(mark.lines.slice(0, 3)).toEqual(["7.00 m", "Horizontal 5.00 m", "Height +2.00 m"]);
  expect(mark.lines.at(-1)).toBe("3 points");
});

test("marks are the same objects until the store has others, and clearing takes both", () => {
  const store = createStore({ manifest, tool: "brush", picked, measured: [[0, 0, 0]] } as unknown as ViewerState);
  const rays: unknown[] = [];
  const tools = headsetTools({ store, regions, tools: { useRay: (ray) => rays.push(ray) } });
  expect(tools.tool()).toBe("land");
  tools.setTool("measure");
  expect(tools.tool()).toBe("measure");
  const first = tools.picked();
  expect(tools.picked()).toBe(first);
  store.set({ picked: { ...picked, answer: "none" } });
  expect(tools.picked()).not.toBe(first);
  tools.use([0, 1, 0], [0, -1, 0]);
  expect(rays).toEqual([{ origin: [0, 1, 0], direction: [0, -1, 0] }]);
  tools.clear();
  expect([tools.picked(), tools.measured()]).toEqual([null, null]);
});
