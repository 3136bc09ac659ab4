/** Clicks of the landing tool: where the target is put, and when nobody could stand there. */

import { describe, expect, it } from "vitest";
import { createStore } from "../src/app/store.ts";
import { createGroundTools } from "../src/app/viewer/ground-tools.ts";
import type { ViewerState } from "../src/app/viewer/state.ts";
import type { Vec3 } from "../src/core/types.ts";
import type { GroundHit } from "../src/three/types.ts";

const WALL: Vec3 = [5, 4, 0];
const FOOT: Vec3 = [4.5, 0, 0];
const HIT: GroundHit = { position: WALL, normal: [-1, 0, 0], isOuter: true, distanceM: 9, segment: 1, region: 2 };

/** Tools of a page on which every click meets a wall; what they do, in order. */
function toolsAtWall(view: "orbit" | "walk", foothold: Vec3 | null, met: GroundHit | null = HIT) {
  const store = createStore({ view, tool: "land", aim: null } as unknown as ViewerState);
  const calls: string[] = [];
  const tools = createGroundTools({
    store,
    stream: { pick: () => Promise.resolve(null) },
    rayAt: () => ({ origin: [0, 2, 0], direction: [1, 0, 0] }),
    cast: () => met,
    standNear: () => foothold,
    pixelOf: () => ({ x: 900, y: 900 }),
    aim(at) {
      store.set({ aim: { place: at, radiusM: 60, bytes: 0 } });
      calls.push(`aim ${at}`);
    },
    cancelAim: () => store.set({ aim: null }),
    land: (at) => calls.push(`land ${at}`),
    announce: (text) => calls.push(text),
    refuse: (why) => calls.push(`refuse ${why}`),
  });
  return { tools, calls };
}

describe("a click on a wall", () => {
  it("lands where one can stand, and says so", () => {
    const { tools, calls } = toolsAtWall("orbit", FOOT);
    tools.tap(10, 10);
    expect(calls).toEqual(["refuse null", "land 4.5,0,0", "Nobody could stand there. The target is 4.03 m beside"]);
  });

  it("that is held aims there, and lands when it is let go", () => {
    const { tools, calls } = toolsAtWall("walk", FOOT);
    expect(tools.press(10, 10)).toBe(true);
    expect(calls[1]).toBe("aim 4.5,0,0");
    tools.pressEnd(false);
    expect(calls.at(-1)).toBe("land 4.5,0,0");
  });

  it("aims by the keys' way alone", () => {
    const { tools, calls } = toolsAtWall("orbit", FOOT);
    tools.aimAt(10, 10);
    expect(calls[1]).toBe("aim 4.5,0,0");
  });

  it("without a foothold is refused to a walker", () => {
    const { tools, calls } = toolsAtWall("walk", null);
    tools.tap(10, 10);
    expect(tools.press(10, 10)).toBe(false);
    expect(calls).toEqual(["refuse null", "refuse steep", "refuse null", "refuse steep"]);
  });

  it("without a foothold is looked at from above", () => {
    const { tools, calls } = toolsAtWall("orbit", null);
    tools.tap(10, 10);
    expect(calls).toEqual(["refuse null", "land 5,4,0"]);
  });
});

describe("a click on nothing", () => {
  it("says so, and lands nowhere", () => {
    const { tools, calls } = toolsAtWall("orbit", FOOT, null);
    tools.tap(10, 10);
    expect(tools.press(10, 10)).toBe(false);
    expect(calls).toEqual(["refuse nothing", "refuse nothing"]);
  });
});
