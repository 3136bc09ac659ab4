import { describe, expect, test } from "vitest";
import {
  azimuthOfYaw,
  facingOf,
  type HeadPose,
  keepAcrossReset,
  type RigPose,
  rigOver,
  toScene,
  turnAboutHead,
  wrapAngle,
  yawOfAzimuth,
  yawOfQuaternion,
} from "../src/xr/pose.ts";

const QUARTER = Math.PI / 2;
const rig: RigPose = { position: [10, 3, -20], yawRad: 0.7 };
const head: HeadPose = { position: [0.8, 1.72, -1.1], yawRad: -0.4 };

/** Quaternion of a yaw about Y followed by a pitch about the head's own X. */
function quaternionOf(yawRad: number, pitchRad: number): [number, number, number, number] {
  const cy = Math.cos(yawRad / 2);
  const sy = Math.sin(yawRad / 2);
  const cp = Math.cos(pitchRad / 2);
  const sp = Math.sin(pitchRad / 2);
  return [cy * sp, sy * cp, -sy * sp, cy * cp];
}

function expectClose(actual: readonly number[], expected: readonly number[]): void {
  expect(actual.length).toBe(expected.length);
  for (const [k, value] of expected.entries()) {
    expect(actual[k]).toBeCloseTo(value, 9);
  }
}

describe("angles", () => {
  test("are wrapped into half a turn either way", () => {
    expect(wrapAngle(0.5)).toBe(0.5);
    expect(wrapAngle(3 * QUARTER)).toBeCloseTo(-QUARTER);
    expect(wrapAngle(-3 * QUARTER)).toBeCloseTo(QUARTER);
    expect(wrapAngle(9 * Math.PI)).toBeCloseTo(Math.PI);
  });

  test("azimuths go clockwise from north", () => {
    // East is +X: looking along it is a quarter turn clockwise.
    expect(yawOfAzimuth(90)).toBeCloseTo(-QUARTER);
    expect(azimuthOfYaw(-QUARTER)).toBeCloseTo(90);
    for (const azimuth of [0, 45, 180, 271.5]) {
      expect(azimuthOfYaw(yawOfAzimuth(azimuth))).toBeCloseTo(azimuth);
    }
  });
});

describe("facing of a head", () => {
  test.each([-2, -0.3, 0, 1.1, 3])("yaw %d, whatever the pitch", (yaw) => {
    for (const pitch of [-1.5, -1.2, 0, 0.9, 1.5]) {
      expect(yawOfQuaternion(...quaternionOf(yaw, pitch))).toBeCloseTo(yaw, 6);
    }
  });

  test("does not jump where the line of sight becomes too steep to tell", () => {
    for (let pitch = -1.57; pitch < 1.57; pitch += 0.01) {
      expect(yawOfQuaternion(...quaternionOf(0.6, pitch))).toBeCloseTo(0.6, 6);
    }
  });
});

describe("rig", () => {
  test("carries the play space by hand", () => {
    // Turned a quarter to the left, what is ahead (-Z) in the room lies to the west (-X) in the scene.
    expectClose(toScene({ position: [5, 0, 0], yawRad: QUARTER }, [0, 1.7, -2]), [3, 1.7, 0]);
  });

  test("puts the head, not the middle of the play space, over the ground that was pointed at", () => {
    const ground = [31, -4.5, 12] as const;
    const landed = rigOver(ground, head, 2.1, 0);
    const eye = toScene(landed, head.position);
    expectClose([eye[0], eye[2]], [31, 12]);
    // The floor of the room is the ground: the eyes stay as high over it as they are.
    expect(landed.position[1]).toBe(-4.5);
    expect(eye[1]).toBeCloseTo(-4.5 + 1.72);
    expect(facingOf(landed, head)).toBeCloseTo(2.1);
  });

  test("lifts somebody whose floor is not known to the eye height of who stands", () => {
    const landed = rigOver([0, 7, 0], { position: [0, 0, 0], yawRad: 0 }, 0, -1.6);
    expect(toScene(landed, [0, 0, 0])[1]).toBeCloseTo(8.6);
  });

  test.each([Math.PI / 6, -Math.PI / 4, 2])("turned by %d about the head, the head keeps its place", (angle) => {
    const turned = turnAboutHead(rig, head, angle);
    expectClose(toScene(turned, head.position), toScene(rig, head.position));
    expect(wrapAngle(facingOf(turned, head) - facingOf(rig, head))).toBeCloseTo(angle);
  });

  test("is not turned about its own origin", () => {
    expect(turnAboutHead(rig, head, 1).position).not.toEqual(rig.position);
  });

  test("a positive turn is to the left", () => {
    const turned = turnAboutHead({ position: [0, 0, 0], yawRad: 0 }, { position: [0, 1.7, 0], yawRad: 0 }, QUARTER);
    expectClose(toScene(turned, [0, 0, -1]), [-1, 0, 0]);
  });

  test("recentred: nothing moves before the eyes", () => {
    const after: HeadPose = { position: [0, 1.69, 0], yawRad: 0 };
    const rigAfter = keepAcrossReset(rig, head, after);
    const positionBefore = toScene(rig, head.position);
    const positionAfter = toScene(rigAfter, after.position);
    expectClose([positionAfter[0], positionAfter[2]], [positionBefore[0], positionBefore[2]]);
    expect(facingOf(rigAfter, after)).toBeCloseTo(facingOf(rig, head));
    expect(rigAfter.position[1]).toBe(rig.position[1]);
  });
});
