/** Orbiting and walking: where the eye is. */

import { describe, expect, test } from "vitest";
import { EYE_HEIGHT_M, isSettling, openYaw, placed, type WalkInput, walkEye, walked } from "../src/app/walk-pose.ts";
import type { Bounds } from "../src/core/types.ts";
import { farthest, framing, type OrbitPose, orbitEye, panned, turned, zoomed } from "../src/three/orbit-pose.ts";

const POSE: OrbitPose = { target: [10, 2, -5], yawDeg: 0, pitchDeg: -30, distanceM: 100 };
const BOUNDS: Bounds = [-200, 0, -180, 200, 60, 180];
const STILL: WalkInput = { forward: 0, right: 0, turn: 0, nod: 0, fast: false };

describe("an orbit", () => {
  test("looks north from the south, and down", () => {
    const eye = orbitEye(POSE);
    expect(eye[0]).toBeCloseTo(10, 9);
    expect(eye[1]).toBeCloseTo(52, 9);
    expect(eye[2]).toBeCloseTo(-5 + 100 * Math.cos(Math.PI / 6), 9);
  });

  test("turns at the same distance, and never over the top", () => {
    const pose = turned(POSE, 725, -500);
    expect(pose.yawDeg).toBeCloseTo(5, 9);
    expect(pose.pitchDeg).toBeGreaterThan(-90);
    const eye = orbitEye(pose);
    expect(Math.hypot(eye[0] - 10, eye[1] - 2, eye[2] + 5)).toBeCloseTo(100, 9);
  });

  test("moves where the user looks", () => {
    expect(panned({ ...POSE, yawDeg: 90 }, 0, 10).target[0]).toBeCloseTo(20, 9);
    expect(panned(POSE, 0, 10).target[2]).toBeCloseTo(-15, 9);
    expect(panned(POSE, 10, 0).target[0]).toBeCloseTo(20, 9);
  });

  test("keeps what it comes nearer to on its pixel", () => {
    const about = [40, 5, -60] as const;
    const direction = (pose: OrbitPose) => {
      const eye = orbitEye(pose);
      const size = Math.hypot(about[0] - eye[0], about[1] - eye[1], about[2] - eye[2]);
      return about.map((value, axis) => (value - eye[axis]!) / size);
    };
    const nearer = zoomed(POSE, 0.5, 1000, about);
    expect(nearer.distanceM).toBe(50);
    for (const [axis, value] of direction(nearer).entries()) expect(value).toBeCloseTo(direction(POSE)[axis]!, 9);
    expect(zoomed(POSE, 1e9, 1000).distanceM).toBe(1000);
  });

  test.each([
    [16 / 9, "desk"],
    [9 / 19, "phone"],
  ])("frames all of the scene at aspect %d (%s)", (aspect) => {
    const fov = 55;
    const pose = framing(BOUNDS, fov, aspect);
    const eye = orbitEye(pose);
    const pitch = (pose.pitchDeg * Math.PI) / 180;
    const half = Math.tan((fov * Math.PI) / 360);
    for (const x of [BOUNDS[0], BOUNDS[3]]) {
      for (const y of [BOUNDS[1], BOUNDS[4]]) {
        for (const z of [BOUNDS[2], BOUNDS[5]]) {
          const [dx, dy, dz] = [x - eye[0], y - eye[1], z - eye[2]];
          const depth = dy * Math.sin(pitch) - dz * Math.cos(pitch);
          const up = dy * Math.cos(pitch) + dz * Math.sin(pitch);
          expect(depth).toBeGreaterThan(0);
          expect(Math.abs(dx) / (depth * half * aspect)).toBeLessThan(1.06);
          expect(Math.abs(up) / (depth * half)).toBeLessThan(1.02);
        }
      }
    }
    expect(pose.distanceM).toBeLessThan(farthest(BOUNDS));
  });
});

describe("who comes down", () => {
  test("looks as before where there is a view", () => {
    expect(openYaw(30, () => Number.POSITIVE_INFINITY)).toBe(30);
    expect(openYaw(30, () => 5)).toBe(30);
  });

  test("turns away from a wall, as little as shows something", () => {
    // A wall to the north, from north-west to north-east.
    const sightM = (yawDeg: number) => (Math.cos((yawDeg * Math.PI) / 180) > 0.5 ? 0.8 : 40);
    expect(openYaw(0, sightM)).toBe(90);
    expect(sightM(openYaw(350, sightM))).toBe(40);
  });

  test("looks along the longest way in a pit", () => {
    expect(openYaw(0, (yawDeg) => (yawDeg === 180 || yawDeg === -180 ? 3 : 1))).toSatisfy(
      (yawDeg: number) => Math.abs(yawDeg) === 180,
    );
  });
});

describe("a walker", () => {
  const level = () => 3;

  test("stands with the eyes 1.7 m above the ground", () => {
    expect(walkEye(placed([1, 50, 2], 0, 0, level))).toEqual([1, 3 + EYE_HEIGHT_M, 2]);
    expect(placed([1, 50, 2], 0, 0, () => null).feet).toEqual([1, 50, 2]);
  });

  test("walks forward where it looks, no faster aslant, faster with Shift", () => {
    const pose = placed([0, 0, 0], 90, 0, level);
    const forward = walked(pose, { ...STILL, forward: 1 }, 0.05, level);
    expect(forward.feet[0]).toBeCloseTo(0.11, 9);
    expect(forward.feet[2]).toBeCloseTo(0, 9);
    const aslant = walked(pose, { ...STILL, forward: 1, right: 1 }, 0.05, level);
    expect(Math.hypot(aslant.feet[0], aslant.feet[2])).toBeCloseTo(0.11, 9);
    expect(walked(pose, { ...STILL, forward: 1, fast: true }, 0.05, level).feet[0]).toBeCloseTo(0.45, 9);
  });

  test("is not thrown far after a pause", () => {
    const pose = walked(placed([0, 0, 0], 0, 0, level), { ...STILL, forward: 1 }, 60, level);
    expect(Math.abs(pose.feet[2])).toBeLessThan(0.3);
  });

  test("follows the ground, the eye a little later", () => {
    const slope = (x: number) => x;
    let pose = placed([0, 0, 0], 90, 0, slope);
    for (let step = 0; step < 60; step += 1) {
      pose = walked(pose, { ...STILL, forward: 1, fast: true }, 1 / 60, slope);
      expect(pose.feet[1]).toBeCloseTo(pose.feet[0], 9);
    }
    expect(pose.feet[0]).toBeCloseTo(9, 6);
    expect(isSettling(pose)).toBe(true);
    for (let step = 0; step < 60; step += 1) pose = walked(pose, STILL, 1 / 60, slope);
    expect(isSettling(pose)).toBe(false);
    expect(pose.eyeY).toBeCloseTo(pose.feet[1] + EYE_HEIGHT_M, 9);
  });

  test("goes along a wall, and not over the edge of the ground", () => {
    const wall = (x: number) => (x > 1 ? 10 : 0);
    let pose = placed([0.95, 0, 0], 45, 0, wall);
    for (let step = 0; step < 30; step += 1) pose = walked(pose, { ...STILL, forward: 1, fast: true }, 1 / 60, wall);
    expect(pose.feet[0]).toBeLessThanOrEqual(1);
    expect(pose.feet[2]).toBeLessThan(-1);
    const edge = (x: number, z: number) => (Math.hypot(x, z) < 5 ? 0 : null);
    pose = placed([0, 0, 0], 0, 0, edge);
    for (let step = 0; step < 300; step += 1) pose = walked(pose, { ...STILL, forward: 1, fast: true }, 1 / 60, edge);
    expect(Math.hypot(pose.feet[0], pose.feet[2])).toBeLessThan(5);
  });
});
