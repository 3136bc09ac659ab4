/** Turning about a point. PURE. Yaw is a compass azimuth of the look (0 north, -Z; 90 east, +X); pitch up positive. */

import type { Bounds, Vec3 } from "../core/types.ts";

/** What the eye turns about, how it looks there, and from how far. */
export interface OrbitPose {
  readonly target: Vec3;
  readonly yawDeg: number;
  readonly pitchDeg: number;
  readonly distanceM: number;
}

/** Never quite straight down or level: the up direction stays defined, and the eye does not sink into the ground. */
const MIN_PITCH_DEG = -89.5;
const MAX_PITCH_DEG = 15;

/** Nearer than this a hand would touch the ground. */
const MIN_DISTANCE_M = 0.5;

/** Unit vector of a look. */
export function lookDirection(yawDeg: number, pitchDeg: number): Vec3 {
  const yaw = (yawDeg * Math.PI) / 180;
  const pitch = (pitchDeg * Math.PI) / 180;
  return [Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), -Math.cos(yaw) * Math.cos(pitch)];
}

/** Where the eye is. */
export function orbitEye(pose: OrbitPose): Vec3 {
  const look = lookDirection(pose.yawDeg, pose.pitchDeg);
  return [
    pose.target[0] - look[0] * pose.distanceM,
    pose.target[1] - look[1] * pose.distanceM,
    pose.target[2] - look[2] * pose.distanceM,
  ];
}

/** Turned by so many degrees. */
export function turned(pose: OrbitPose, yawDeg: number, pitchDeg: number): OrbitPose {
  return { ...pose, yawDeg: wrapped(pose.yawDeg + yawDeg), pitchDeg: clampPitch(pose.pitchDeg + pitchDeg) };
}

/** Moved over the ground: `rightM` to the right of the look, `forwardM` along it, level. */
export function panned(pose: OrbitPose, rightM: number, forwardM: number): OrbitPose {
  const yaw = (pose.yawDeg * Math.PI) / 180;
  const x = Math.cos(yaw) * rightM + Math.sin(yaw) * forwardM;
  const z = Math.sin(yaw) * rightM - Math.cos(yaw) * forwardM;
  return { ...pose, target: [pose.target[0] + x, pose.target[1], pose.target[2] + z] };
}

/**
 * Nearer (`factor` below 1) or farther, the point `about` staying on its pixel: what the user points at is what comes
 * nearer.
 */
export function zoomed(pose: OrbitPose, factor: number, maxDistanceM: number, about: Vec3 | null = null): OrbitPose {
  const distanceM = Math.min(maxDistanceM, Math.max(MIN_DISTANCE_M, pose.distanceM * factor));
  if (about === null) return { ...pose, distanceM };
  const share = 1 - distanceM / pose.distanceM;
  const target = pose.target.map((value, axis) => value + (about[axis]! - value) * share);
  return { ...pose, distanceM, target: [target[0]!, target[1]!, target[2]!] };
}

/** The opening view: all of a box, from the south, as maps have it, at a slant that shows the relief. */
export function framing(bounds: Bounds, verticalFovDeg: number, aspect: number): OrbitPose {
  const size: Vec3 = [bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]];
  const target: Vec3 = [bounds[0] + size[0] / 2, bounds[1] + size[1] * 0.4, bounds[2] + size[2] / 2];
  const pitchDeg = -32;
  const pitch = (-pitchDeg * Math.PI) / 180;
  const half = Math.tan((verticalFovDeg * Math.PI) / 360);
  // The box's outline in the picture, for an eye far away; its near edge is nearer by half its depth.
  const wide = size[0] / 2 / (half * aspect);
  const high = (size[2] * Math.sin(pitch) + size[1] * Math.cos(pitch)) / 2 / half;
  const distanceM = Math.max(wide, high) * 1.02 + (size[2] * Math.cos(pitch)) / 2;
  return { target, yawDeg: 0, pitchDeg, distanceM: Math.max(MIN_DISTANCE_M, distanceM) };
}

/** How far a scene may be zoomed out: it is still more than a speck. */
export function farthest(bounds: Bounds): number {
  return 4 * Math.max(10, Math.hypot(bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]));
}

/** Within what orbiting allows. */
export function clampPitch(pitchDeg: number): number {
  return Math.min(MAX_PITCH_DEG, Math.max(MIN_PITCH_DEG, pitchDeg));
}

/** 0 to 360. */
export function wrapped(degrees: number): number {
  return ((degrees % 360) + 360) % 360;
}
