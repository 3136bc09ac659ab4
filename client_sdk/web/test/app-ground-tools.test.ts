/** Clicks of the landing tool: where the target is put, and when nobody could stand there. */

import { describe, expect, it } from "vitest";
import { createStore } from "../src/app/store.ts";
import { createGroundTools } from "../src/app/viewer/ground-tools.ts";
import type { ViewerState } from "../src/app/viewer/state.ts";
import type { Vec3 } from "../src/core/types.ts";
import type { GroundHit } from "../src/three/types.ts";

const WALL: Vec3 = [5, 4, 0];
const FOOT: Vec3 = [4.5, 0, 0];

/** Tools of a page on which every click meets a wall; what they do, in order. */
function toolsAtWall(view: "orbit" | "walk", foothold: Vec3 | null) {
  const store = createStore({ view, tool: "land", aim: null } as unknown as ViewerState);
  const calls: string[] = [];
  const hit: GroundHit = { position: WALL, normal: [-1, 0, 0], isOuter: true, distanceM: 9, segment: 1, region: 2 };
  const tools = createGroundTools({
    store,
    stream: { pick: () => Promise.resolve(null) },
    rayAt: () => ({ origin: [0, 2, 0], direction: [1, 0, 0] }),
    cast: () => hit,
    standNear: () => foothold,
    pixelOf: () => ({ x: 900, y: 900 }),
    aim(at) {
      store.set({ aim: { place: at, radiusM: 60, fraction: null, bytes: 0 } });
      calls.push(`aim ${at}`);
    },
    land: (at) => calls.push(`land ${at}`),
    announce: (text) => calls.push(text),
    refuse: (why) => calls.push(`refuse ${why}`),
  });
  return { tools, calls };
}

describe("a click on a wall", () => {
  it("puts the target where one can stand, says so, and lands by a second click on the wall", () => {
    const { tools, calls } = toolsAtWall("walk", FOOT);
    tools.tap(10, 10);
    expect(calls).toEqual(["refuse null", "aim 4.5,0,0", "Nobody could stand there. The target is 4.03 m beside"]);
    tools.tap(10, 10);
    expect(calls.at(-1)).toBe("land 4.5,0,0");
  });

  it("without a foothold is refused to a walker", () => {
    const { tools, calls } = toolsAtWall("walk", null);
    tools.tap(10, 10);
    expect(tools.press(10, 10)).toBe(false);
    expect(calls).toEqual(["refuse steep", "refuse steep"]);
  });

  it("without a foothold is looked at from above", () => {
    const { tools, calls } = toolsAtWall("orbit", null);
    tools.tap(10, 10);
    expect(calls).toEqual(["refuse null", "aim 5,4,0"]);
  });
});
