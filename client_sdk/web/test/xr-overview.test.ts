import { describe, expect, test } from "vitest";
import type { Bounds, Vec3 } from "../src/core/types.ts";
import { BOARD_AWAY_M, BOARD_FONT } from "../src/xr/board.ts";
import { LABEL_AS_AT_M, LABEL_FONT } from "../src/xr/marks.ts";
import { MENU_AWAY_M, MENU_FONTS } from "../src/xr/menu.ts";
import { HINT_AWAY_M, HINT_FONT } from "../src/xr/overview.ts";
import { miniatureBefore, onModel, rayOverGround } from "../src/xr/overview-place.ts";
import { capitalsDeg } from "../src/xr/panel.ts";

const PIT: Bounds = [-800, 40, -600, 700, 190, 500];

describe("the overview", () => {
  test("a pit of 1.5 km is within a step of the hand, before the user and below the eyes", () => {
    const eye: Vec3 = [120, 90, -30];
    for (const facing of [0, 1, -2.5]) {
      const pose = miniatureBefore(PIT, eye, facing);
      const corners = [
        [-800, 40, -600],
        [700, 190, 500],
      ] as const;
      const [low, high] = corners.map((corner) => onModel(pose, corner));
      expect(high![0] - low![0]).toBeCloseTo(0.9);
      expect(high![1]).toBeLessThan(eye[1] - 0.3);
      const [x, , z] = pose.at;
      expect(Math.hypot(x - eye[0], z - eye[2])).toBeCloseTo(0.85);
      // Ahead: along the facing, counter-clockwise from north.
      expect((x - eye[0]) * -Math.sin(facing) + (z - eye[2]) * -Math.cos(facing)).toBeGreaterThan(0);
    }
  });

  test("a tower stays below the eyes", () => {
    const pose = miniatureBefore([0, 0, 0, 10, 100, 10], [0, 2, 0], 0);
    expect(onModel(pose, [5, 100, 5])[1]).toBeLessThan(2);
  });

  test("a ray at a place of the model is a ray at that place of the ground", () => {
    const pose = miniatureBefore(PIT, [3, 91.6, 4], 0.7);
    const place: Vec3 = [-412, 77, 133];
    const hand: Vec3 = [3.2, 91.3, 3.8];
    const on = onModel(pose, place);
    const direction = on.map((value, axis) => value - hand[axis]!) as [number, number, number];
    const from = rayOverGround(pose, hand);
    // Along the same direction, as many metres of the ground as the model is smaller.
    for (let axis = 0; axis < 3; axis++) {
      expect(from[axis]! + direction[axis]! / pose.scale).toBeCloseTo(place[axis]!, 6);
    }
  });

  test("a scene without extent has a model all the same", () => {
    expect(miniatureBefore([1, 2, 3, 1, 2, 3], [0, 0, 0], 0).scale).toBeLessThanOrEqual(0.9);
  });
});

test.each([
  ["the menu's status", MENU_FONTS.status, MENU_AWAY_M],
  ["the menu's buttons", MENU_FONTS.button, MENU_AWAY_M],
  ["the board", BOARD_FONT, BOARD_AWAY_M],
  ["a label", LABEL_FONT, LABEL_AS_AT_M],
  ["the overview's hint", HINT_FONT, HINT_AWAY_M],
])("capitals of %s are a degree high", (_, font, awayM) => {
  expect(capitalsDeg(font, awayM)).toBeGreaterThanOrEqual(1);
});
