/** Where a panel hangs in the world, and where a ray meets it. No three.js. */

import type { Vec3 } from "../core/types.ts";

/** A panel that stands upright, or leans: its middle, turned to face somebody. */
export interface PanelPose {
  readonly centre: Vec3;
  /** Turn about the vertical; 0: it faces +Z, towards somebody who looks along -Z. */
  readonly yawRad: number;
  /** Leaning back, radians: its face looks up by so much. */
  readonly leanRad: number;
}

/** A panel before somebody's eyes, `awayM` ahead along their facing and `belowM` under their eyes, its face to them. */
export function panelBefore(eye: Vec3, facingRad: number, awayM: number, belowM: number): PanelPose {
  return {
    centre: [eye[0] - Math.sin(facingRad) * awayM, eye[1] - belowM, eye[2] - Math.cos(facingRad) * awayM],
    yawRad: facingRad,
    leanRad: Math.atan2(belowM, awayM),
  };
}

/** Axes of a panel: to its right, its up, and out of its face. */
function axesOf(pose: PanelPose): { right: Vec3; up: Vec3; out: Vec3 } {
  const cos = Math.cos(pose.yawRad);
  const sin = Math.sin(pose.yawRad);
  const cosLean = Math.cos(pose.leanRad);
  const sinLean = Math.sin(pose.leanRad);
  return {
    right: [cos, 0, -sin],
    up: [-sin * sinLean, cosLean, -cos * sinLean],
    out: [sin * cosLean, sinLean, cos * cosLean],
  };
}

/** Where on a panel a ray meets its face: metres right of and above its middle, and along the ray; null where it does not. */
export function meetPanel(
  pose: PanelPose,
  origin: Vec3,
  direction: Vec3,
): { readonly x: number; readonly y: number; readonly distanceM: number } | null {
  const { right, up, out } = axesOf(pose);
  const length = Math.hypot(direction[0], direction[1], direction[2]);
  const approach = dot(direction, out) / length;
  if (approach > -1e-4) {
    return null;
  }
  const offset: Vec3 = [pose.centre[0] - origin[0], pose.centre[1] - origin[1], pose.centre[2] - origin[2]];
  const distanceM = dot(offset, out) / approach;
  if (distanceM < 0) {
    return null;
  }
  const along = distanceM / length;
  const local: Vec3 = [
    direction[0] * along - offset[0],
    direction[1] * along - offset[1],
    direction[2] * along - offset[2],
  ];
  return { x: dot(local, right), y: dot(local, up), distanceM };
}

function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
