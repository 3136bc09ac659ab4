/** What the page says of other scenes that are being built: what is shown after each look at the list. */

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Notice } from "../src/app/failures.ts";
import { buildingStep } from "../src/app/format.ts";
import { watchBuilding } from "../src/app/viewer/building-watch.ts";
import type { Notices } from "../src/app/viewer/notices.ts";
import type { SceneList } from "../src/core/scene/list.ts";

let notices: Map<string, Notice>;
let list: SceneList | Error;
let looks: number;

function board(): Notices {
  return {
    element: null as never,
    get current() {
      return [...notices.values()];
    },
    show: (notice) => void notices.set(notice.key, notice),
    clear: (key) => void notices.delete(key),
    dispose: () => undefined,
  };
}

function listed(sceneIds: readonly string[], buildingIds: readonly string[], share: number | null = 0.439): SceneList {
  return {
    scenes: sceneIds.map((id) => ({
      id,
      name: id,
      version: "0",
      segments: 1,
      detailFaces: 1,
      reportUrl: "",
      reportPdfUrl: "",
      previewUrl: "",
    })),
    building: buildingIds.map((id) => ({ id, name: `The ${id}`, step: "clean: normals", share })),
    links: {},
  };
}

function watch(): { dispose(): void } {
  return watchBuilding({
    sceneId: "bench",
    notices: board(),
    list: async () => {
      looks += 1;
      if (list instanceof Error) throw list;
      return list;
    },
  });
}

const texts = () => [...notices.values()].map(({ title, text }) => `${title}: ${text}`);
const pass = () => vi.advanceTimersByTimeAsync(2000);

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("window", globalThis);
  notices = new Map();
  looks = 0;
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

test("a build is followed until its scene is listed, and then no more", async () => {
  list = listed(["bench"], ["quarry"]);
  watch();
  await pass();
  expect(texts()).toEqual(["The quarry is being built: Clean: normals, 43 %. Look around here until it is ready."]);
  list = listed(["bench"], []);
  await pass();
  expect(texts()[0]).toContain("is being built");
  list = listed(["bench", "quarry"], []);
  await pass();
  expect(texts()).toEqual(["The quarry is ready: Open it from the list of scenes."]);
  const after = looks;
  await pass();
  expect(looks).toBe(after);
});

test("a build that ended without a scene is not spoken of", async () => {
  list = listed(["bench"], ["quarry"]);
  watch();
  await pass();
  list = listed(["bench"], []);
  for (let look = 0; look < 4; look++) await pass();
  expect(texts()).toEqual([]);
});

test("who dismissed it hears of it again when it is ready", async () => {
  list = listed(["bench"], ["quarry"]);
  watch();
  await pass();
  notices.delete("building");
  await pass();
  await pass();
  expect(texts()).toEqual([]);
  list = listed(["bench", "quarry"], []);
  await pass();
  expect(texts()[0]).toContain("is ready");
});

test("nothing is asked again where nothing else is built, where the list fails, and after the end", async () => {
  for (list of [listed(["bench"], []), listed(["bench"], ["bench"]), new Error("gone")]) {
    looks = 0;
    watch();
    await pass();
    await pass();
    expect([looks, texts()]).toEqual([1, []]);
  }
  list = listed(["bench"], ["quarry"]);
  const watching = watch();
  await pass();
  watching.dispose();
  const after = looks;
  await pass();
  expect(looks).toBe(after);
});

test("a step without a share has no per cent", () => {
  expect(buildingStep(listed([], ["a"], null).building[0]!)).toBe("Clean: normals");
  expect(buildingStep(listed([], ["a"], 1).building[0]!)).toBe("Clean: normals, 100 %");
});
