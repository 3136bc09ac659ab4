import { describe, expect, test } from "vitest";
import type { Vec3 } from "../src/core/types.ts";
import { judgeFooting, newStand } from "../src/three/footing.ts";
import type { GroundHit } from "../src/three/types.ts";
import { ARC_DEFAULTS, castArc, cutShort, flightS, newArc, pointsAway, throwArc } from "../src/xr/arc.ts";

/** Ground as a height over (x, z), met by small steps: slow, and plain enough to trust. Null: no ground there. */
function terrain(heightAt: (x: number, z: number) => number | null) {
  const hitAt = (x: number, z: number, y: number, normal: Vec3 = [0, 1, 0]): GroundHit => ({
    position: [x, y, z],
    normal,
    distanceM: 0,
    segment: -1,
    isOuter: true,
    region: -1,
  });
  const ground = {
    casts: 0,
    cast(origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null {
      ground.casts += 1;
      const length = Math.hypot(...direction);
      for (let t = 0; t <= maxDistanceM; t += 0.002) {
        const [x, y, z] = origin.map((value, axis) => value + (direction[axis]! / length) * t) as [
          number,
          number,
          number,
        ];
        const height = heightAt(x, z);
        if (height !== null && y <= height) {
          return { ...hitAt(x, z, y), distanceM: t };
        }
      }
      return null;
    },
    groundAt(x: number, z: number): GroundHit | null {
      ground.casts += 1;
      const height = heightAt(x, z);
      return height === null ? null : hitAt(x, z, height);
    },
  };
  return ground;
}

const hand: Vec3 = [0, 1.4, 0];

describe("arc", () => {
  test("of a throw straight up ends as far below the hand as it may", () => {
    const arc = newArc();
    throwArc(arc, [0, 1.4, 0], [0, 1, 0]);
    const end = 3 * (arc.count - 1);
    expect(arc.points[end + 1]).toBeCloseTo(1.4 - ARC_DEFAULTS.maxDropM, 3);
  });

  test("is a thrown stone's path", () => {
    const arc = newArc();
    throwArc(arc, [1, 2, 3], [0, 3, -4]);
    const upMS = (ARC_DEFAULTS.speedMS * 3) / 5;
    const alongMS = (ARC_DEFAULTS.speedMS * 4) / 5;
    const step = flightS(upMS, alongMS, ARC_DEFAULTS) / ARC_DEFAULTS.pieces;
    expect(arc.count).toBe(ARC_DEFAULTS.pieces + 1);
    for (let k = 0; k < arc.count; k++) {
      const t = k * step;
      expect(arc.points[3 * k]).toBeCloseTo(1, 4);
      expect(arc.points[3 * k + 1]).toBeCloseTo(2 + upMS * t - 0.5 * 9.81 * t * t, 4);
      expect(arc.points[3 * k + 2]).toBeCloseTo(3 - alongMS * t, 4);
    }
  });

  test("reaches speed squared over gravity on level ground", () => {
    const arc = newArc();
    throwArc(arc, [0, 0, 0], [0, 1, -1]);
    castArc(
      arc,
      terrain(() => -0.001),
    );
    const reach = ARC_DEFAULTS.speedMS ** 2 / ARC_DEFAULTS.gravityMS2;
    // The first piece starts on the ground and is met at once by anything that is not above it.
    expect(arc.hit).not.toBeNull();
    expect(Math.abs(arc.hit!.position[2] + reach)).toBeLessThan(0.3);
  });

  test.each([
    [[0, 0, -1], "level"],
    [[0, 1, -0.2], "steeply up"],
    [[0, 1, 0], "straight up"],
    [[0, -1, 0], "straight down"],
    [[1, 0.4, 0.3], "aside"],
  ] as [Vec3, string][])("%j (%s) stays within range and drop", (direction) => {
    const arc = newArc();
    throwArc(arc, hand, direction);
    const last = 3 * (arc.count - 1);
    const reach = Math.hypot(arc.points[last]!, arc.points[last + 2]!);
    expect(reach).toBeLessThanOrEqual(ARC_DEFAULTS.maxRangeM + 1e-3);
    expect(arc.points[last + 1]).toBeGreaterThanOrEqual(hand[1] - ARC_DEFAULTS.maxDropM - 1e-3);
    for (const value of arc.points) {
      expect(Number.isFinite(value)).toBe(true);
    }
  });

  test("the length of the direction does not matter", () => {
    const arc = newArc();
    const scaledArc = newArc();
    throwArc(arc, hand, [0.1, 0.2, -0.9]);
    throwArc(scaledArc, hand, [0.3, 0.6, -2.7]);
    for (const [k, value] of arc.points.entries()) {
      expect(scaledArc.points[k]).toBeCloseTo(value, 4);
    }
  });

  test("straight up is away from the ground; as steeply as one throws far is not", () => {
    expect(pointsAway([0, 1, 0])).toBe(true);
    expect(pointsAway([0, 2, -1])).toBe(true);
    expect(pointsAway([0, 1, -1])).toBe(false);
    expect(pointsAway([0, -1, 0])).toBe(false);
    const arc = newArc();
    throwArc(arc, hand, [0, 3, -1]);
    cutShort(arc);
    expect(arc.hit).toBeNull();
    expect(arc.count).toBeLessThan(6);
  });

  test("ends where it meets the ground, and casts no more after that", () => {
    const arc = newArc();
    const ground = terrain(() => 0);
    throwArc(arc, hand, [0, 0, -1]);
    castArc(arc, ground);
    // 1.4 m of fall take 0.534 s.
    expect(arc.hit!.position[2]).toBeCloseTo(-ARC_DEFAULTS.speedMS * Math.sqrt((2 * 1.4) / 9.81), 0);
    expect(arc.points[3 * (arc.count - 1) + 1]).toBeCloseTo(arc.hit!.position[1], 5);
    expect(ground.casts).toBe(arc.count - 1);
    expect(arc.lengthM).toBeGreaterThan(9);
    expect(arc.lengthM).toBeLessThan(11);
  });

  test("costs no more than 24 casts a frame with its footing, even over nothing", () => {
    const over = terrain(() => null);
    const arc = newArc();
    throwArc(arc, hand, [0, 0.5, -1]);
    castArc(arc, over);
    expect(arc.hit).toBeNull();
    expect(over.casts).toBe(20);
    const ground = terrain(() => -19);
    throwArc(arc, hand, [0, 0.7, -1]);
    castArc(arc, ground);
    judgeFooting(newStand(), arc.hit, ground);
    expect(arc.hit).not.toBeNull();
    expect(ground.casts).toBeLessThanOrEqual(24);
  });
});

describe("footing", () => {
  const at = (position: Vec3, normal: Vec3 = [0, 1, 0]): GroundHit => ({
    position,
    normal,
    distanceM: 1,
    segment: 3,
    region: 1,
    isOuter: true,
  });

  test("level ground is firm, its normal straight up", () => {
    const stand = newStand();
    judgeFooting(
      stand,
      at([2, 0, 2]),
      terrain(() => 0),
    );
    expect(stand).toEqual({ footing: "firm", normal: [-0, 1, -0] });
  });

  test("the ring lies on the slope, not on the pebble that was hit", () => {
    const stand = newStand();
    const slope = Math.tan((30 * Math.PI) / 180);
    judgeFooting(
      stand,
      at([0, 0, 0], [0.98, 0.2, 0]),
      terrain((x) => slope * x),
    );
    expect(stand.footing).toBe("firm");
    expect(stand.normal[0]).toBeCloseTo(-Math.sin((30 * Math.PI) / 180));
    expect(stand.normal[1]).toBeCloseTo(Math.cos((30 * Math.PI) / 180));
    expect(stand.normal[2]).toBeCloseTo(0);
  });

  test.each([
    [49, "firm"],
    [51, "steep"],
    [80, "steep"],
  ] as const)("%d degrees are %s, whichever way they fall", (degrees, footing) => {
    const slope = Math.tan((degrees * Math.PI) / 180);
    for (const turn of [0, 0.5, 1.3, 2.9]) {
      const stand = newStand();
      judgeFooting(
        stand,
        at([0, 0, 0]),
        terrain((x, z) => slope * (x * Math.cos(turn) + z * Math.sin(turn))),
      );
      expect(stand.footing).toBe(footing);
    }
  });

  test("no hit, the scene's edge, a cliff's edge and the underside of things will not do", () => {
    const stand = newStand();
    judgeFooting(
      stand,
      null,
      terrain(() => 0),
    );
    expect(stand.footing).toBe("outside");
    judgeFooting(
      stand,
      at([0, 0, 0]),
      terrain((x) => (x > 0.2 ? null : 0)),
    );
    expect(stand.footing).toBe("outside");
    judgeFooting(
      stand,
      at([0, 0, 0]),
      terrain((x) => (x > 0.2 ? -12 : 0)),
    );
    expect(stand.footing).toBe("steep");
    judgeFooting(
      stand,
      at([0, 4, 0], [0, -1, 0]),
      terrain(() => 4),
    );
    expect(stand.footing).toBe("steep");
  });
});
