/**
 * Where the play space stands in the scene, and how it is put so that the *head* comes where it should.
 *
 * A headset reports the head in the play space: metres, Y up, the floor at 0 (or the eyes at 0 where the system knows no
 * floor). The rig carries the play space. It is only ever turned about the vertical and never scaled, so a metre stays a
 * metre and up stays up. A yaw of 0 looks along -Z (north); positive is counter-clockwise, seen from above.
 */

import type { Vec3 } from "../core/types.ts";

/** The play space in the scene: turned about Y, then moved. */
export interface RigPose {
  readonly position: Vec3;
  readonly yawRad: number;
}

/** The head in the play space: metres from its origin on the real floor, which the rig carries through the scene. */
export interface HeadPose {
  readonly position: Vec3;
  readonly yawRad: number;
}

/** How high the eyes of somebody who stands are set above the ground where the system knows no floor, metres. */
export const EYE_HEIGHT_M = 1.6;

/** The same angle, in (-pi, pi]. */
export function wrapAngle(angleRad: number): number {
  const turned = angleRad % (2 * Math.PI);
  if (turned > Math.PI) {
    return turned - 2 * Math.PI;
  }
  return turned <= -Math.PI ? turned + 2 * Math.PI : turned;
}

/** Yaw of a compass azimuth (0 north, 90 east, degrees), as links and the store write it. */
export function yawOfAzimuth(azimuthDeg: number): number {
  return wrapAngle((-azimuthDeg * Math.PI) / 180);
}

/** Compass azimuth of a yaw, degrees in [0, 360). */
export function azimuthOfYaw(yawRad: number): number {
  const degrees = (-yawRad * 180) / Math.PI;
  return ((degrees % 360) + 360) % 360;
}

/**
 * Which way somebody looks, of the head's quaternion.
 *
 * Looking nearly straight down or up, the line of sight says little about it: then the top of the head does.
 */
export function yawOfQuaternion(x: number, y: number, z: number, w: number): number {
  const forwardX = -2 * (x * z + w * y);
  const forwardY = -2 * (y * z - w * x);
  const forwardZ = -(1 - 2 * (x * x + y * y));
  if (Math.abs(forwardY) < 0.98) {
    return Math.atan2(-forwardX, -forwardZ);
  }
  // Looking down the top of the head points forward, looking up it points backward.
  const sign = forwardY < 0 ? 1 : -1;
  const upX = 2 * (x * y - w * z);
  const upZ = 2 * (y * z + w * x);
  return Math.atan2(-sign * upX, -sign * upZ);
}

/** A place of the play space in the scene. */
export function toScene(rig: RigPose, position: Vec3): Vec3 {
  const cos = Math.cos(rig.yawRad);
  const sin = Math.sin(rig.yawRad);
  return [
    rig.position[0] + position[0] * cos + position[2] * sin,
    rig.position[1] + position[1],
    rig.position[2] - position[0] * sin + position[2] * cos,
  ];
}

/** Which way the head looks in the scene. */
export function facingOf(rig: RigPose, head: HeadPose): number {
  return wrapAngle(rig.yawRad + head.yawRad);
}

/**
 * The rig that brings the head over `ground`, looking along `facingRad`.
 *
 * It is the head's projection on the ground that lands there, not the middle of the play space: somebody who stands at the
 * edge of their room, and points at a ring, wants to stand on that ring. `floorM` is the height of the play space's floor
 * in its own frame: 0, or -EYE_HEIGHT_M where the system puts the eyes at 0.
 */
export function rigOver(ground: Vec3, head: HeadPose, facingRad: number, floorM: number): RigPose {
  const yawRad = wrapAngle(facingRad - head.yawRad);
  const offset = toScene({ position: [0, 0, 0], yawRad }, head.position);
  return { position: [ground[0] - offset[0], ground[1] - floorM, ground[2] - offset[2]], yawRad };
}

/** The rig turned about the head (which keeps its place), counter-clockwise seen from above. */
export function turnAboutHead(rig: RigPose, head: HeadPose, angleRad: number): RigPose {
  const headBefore = toScene(rig, head.position);
  const yawRad = wrapAngle(rig.yawRad + angleRad);
  const headAfter = toScene({ position: rig.position, yawRad }, head.position);
  return {
    position: [
      rig.position[0] + headBefore[0] - headAfter[0],
      rig.position[1],
      rig.position[2] + headBefore[2] - headAfter[2],
    ],
    yawRad,
  };
}

/**
 * The rig after the headset was recentred: the head keeps its place and facing in the scene, so nothing moves before the eyes.
 *
 * The height is kept only by the floor: that the system moved it is why people recentre.
 */
export function keepAcrossReset(rig: RigPose, before: HeadPose, after: HeadPose): RigPose {
  const headPosition = toScene(rig, before.position);
  const yawRad = wrapAngle(rig.yawRad + before.yawRad - after.yawRad);
  const offset = toScene({ position: [0, 0, 0], yawRad }, after.position);
  return { position: [headPosition[0] - offset[0], rig.position[1], headPosition[2] - offset[2]], yawRad };
}
