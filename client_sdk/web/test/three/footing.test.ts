/** Where the feet are put when a wall, an underside or the ground is clicked: real faces, real casts. */

import { describe, expect, it } from "vitest";
import type { Bounds, Vec3 } from "../../src/core/types.ts";
import { FaceBoxes } from "../../src/three/face-boxes.ts";
import { HEADROOM_M, isBuried, MAX_BESIDE_M, standNear } from "../../src/three/footing.ts";
import { castGround, groundOnVertical, type ShownGround } from "../../src/three/ground-picking.ts";
import type { GroundHit } from "../../src/three/types.ts";

const STEP_M = 0.01;
const LOW: Vec3 = [-40, -10, -40];

/** Rock below and to the right of a profile in x and y, from z -40 to 40. Its faces look up, or out to the left. */
function rock(profile: readonly (readonly [number, number])[], isInsideOut = false): ShownGround {
  const positions: number[] = [];
  for (const [x, y] of profile) {
    for (const z of [-40, 40]) {
      const code = [x, y, z].map((value, axis) => Math.round((value - LOW[axis]!) / STEP_M));
      positions.push(...code, 0);
    }
  }
  const indices: number[] = [];
  for (let at = 0; at < profile.length - 1; at += 1) {
    const [a, b, c, d] = [2 * at, 2 * at + 1, 2 * at + 2, 2 * at + 3];
    indices.push(...(isInsideOut ? [a!, c!, b!, c!, d!, b!] : [a!, b!, c!, c!, b!, d!]));
  }
  const bounds: Bounds = [LOW[0], LOW[1], LOW[2], 40, 90, 40];
  const mesh = {
    translation: LOW,
    stepM: STEP_M,
    positions: Uint16Array.from(positions),
    regionIds: null,
    indices: Uint32Array.from(indices),
    faceCount: indices.length / 3,
    bounds,
  };
  return {
    segments: [{ segment: 1, bounds, boxes: new FaceBoxes(mesh) }],
    base: null,
    hidden: undefined,
    pushM: 0,
  };
}

/** What the page asks, counted. */
function landingsOn(ground: ShownGround) {
  return {
    casts: 0,
    cast(origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null {
      this.casts += 1;
      return castGround(ground, origin, direction, maxDistanceM);
    },
    groundAt(x: number, z: number, fromY: number): GroundHit | null {
      this.casts += 1;
      return groundOnVertical(ground, x, z, fromY);
    },
    /** What a click that looks along `direction` meets. */
    clicked(origin: Vec3, direction: Vec3): GroundHit {
      const hit = castGround(ground, origin, direction, 100);
      if (hit === null) throw new Error("nothing there");
      return hit;
    },
  };
}

/** A floor, a wall at x = 5 up to an underside 6 m high, and the overhang's front at x = 0 up to the bench at 10 m. */
const OVERHANG = [
  [-40, 0],
  [5, 0],
  [5, 6],
  [0, 6],
  [0, 10],
  [40, 10],
] as const;

describe("the ground on a vertical", () => {
  const ground = rock(OVERHANG);
  const heightAt = (x: number, fromY: number) => groundOnVertical(ground, x, 0.3, fromY)?.position[1];

  it("is never an underside", () => {
    expect(heightAt(2.5, 3)).toBeCloseTo(0);
    // From within the rock of the overhang: down through its underside.
    expect(heightAt(2.5, 7)).toBeCloseTo(0);
    expect(heightAt(2.5, 12)).toBeCloseTo(10);
    expect(groundOnVertical(ground, 2.5, 0.3, 7)?.distanceM).toBeCloseTo(7);
  });

  it("is the lowest above where there is none below", () => {
    expect(heightAt(2.5, -3)).toBeCloseTo(0);
    expect(heightAt(20, 3)).toBeCloseTo(10);
    expect(heightAt(60, 3)).toBeUndefined();
  });

  it("is what there is in a survey that came out inside out", () => {
    const hit = groundOnVertical(
      rock(
        [
          [-40, 0],
          [40, 0],
        ],
        true,
      ),
      1,
      1,
      5,
    );
    expect(hit?.position[1]).toBeCloseTo(0);
    expect(hit?.normal).toEqual([0, 1, 0]);
  });
});

describe("standing near what was clicked", () => {
  const landings = landingsOn(rock(OVERHANG));

  it("is right there on firm ground", () => {
    const hit = landings.clicked([-10, 5, 0.3], [0, -1, 0]);
    expect(standNear(hit, landings)).toEqual(hit.position);
    expect(hit.isOuter).toBe(true);
  });

  it("is on the floor below an underside", () => {
    const hit = landings.clicked([-3, 1.7, 0.3], [1, 0.8, 0]);
    expect(hit.normal[1]).toBe(-1);
    const foothold = standNear(hit, landings)!;
    expect(foothold[0]).toBeCloseTo(hit.position[0]);
    expect(foothold[1]).toBeCloseTo(0);
  });

  it("is at the foot of a wall, on the side that was seen", () => {
    const foothold = standNear(landings.clicked([-5, 3, 0.3], [1, 0, 0]), landings)!;
    expect(foothold[1]).toBeCloseTo(0);
    expect(foothold[0]).toBeLessThan(5);
    expect(foothold[0]).toBeGreaterThan(3);
  });

  it("is on top where that is nearer", () => {
    const foothold = standNear(landings.clicked([-5, 8.5, 0.3], [1, 0, 0]), landings)!;
    expect(foothold[1]).toBeCloseTo(10);
    expect(foothold[0]).toBeGreaterThan(0);
  });

  it("is not under a ceiling that is too low", () => {
    const low = landingsOn(
      rock([
        [-40, 0],
        [5, 0],
        [5, HEADROOM_M - 0.5],
        [0, HEADROOM_M - 0.5],
        [0, 10],
        [40, 10],
      ]),
    );
    const foothold = standNear(low.clicked([-5, 0.5, 0.3], [1, -0.07, 0]), low)!;
    expect(foothold[1]).toBeCloseTo(0);
    expect(foothold[0]).toBeLessThan(0);
  });

  it("is nowhere on a high cliff, and the search is bounded", () => {
    const cliff = landingsOn(
      rock([
        [-40, 0],
        [5, 0],
        [6, 60],
        [40, 60],
      ]),
    );
    expect(standNear(cliff.clicked([-5, 30, 0.3], [1, 0, 0]), cliff)).toBeNull();
    expect(cliff.casts).toBeLessThanOrEqual(700);
    const foot = standNear(cliff.clicked([-5, MAX_BESIDE_M - 2, 0.3], [1, 0, 0]), cliff)!;
    expect(foot[1]).toBeCloseTo(0);
  });
});

describe("an eye", () => {
  const landings = landingsOn(rock(OVERHANG));

  it.each([
    [[-20, 1.7, 0.3], false, "on the floor"],
    [[3, 1.7, 0.3], false, "under the overhang"],
    [[20, 11.7, 0.3], false, "on the bench"],
    [[3, 8, 0.3], true, "in the overhang's rock"],
    [[20, 5, 0.3], true, "in the rock below the bench"],
    [[-20, -3, 0.3], true, "below the floor"],
    [[200, 1.7, 0.3], true, "beyond the ground"],
  ] as const)("at %j is buried: %s (%s)", (eye, buried, _where) => {
    expect(isBuried(eye, landings)).toBe(buried);
  });
});
