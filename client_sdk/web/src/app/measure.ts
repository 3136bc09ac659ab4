/** What lies between points on the ground. PURE. Frame: Y is up, so the horizontal plane is x, z. */

import type { Vec3 } from "../core/types.ts";

/** From one point to another. */
export interface Leg {
  /** Through the air. */
  readonly straightM: number;
  /** Seen from above. */
  readonly horizontalM: number;
  /** Upwards positive. */
  readonly heightDifferenceM: number;
  /** Of the straight line: 0 level, 90 straight up, -90 straight down. */
  readonly slopeDeg: number;
  /** Compass direction from the first to the second, 0 north (-Z), 90 east (+X); null where one lies above the other. */
  readonly azimuthDeg: number | null;
}

/** A path of two or more points. */
export interface Measurement {
  readonly legs: readonly Leg[];
  /** Sums over the legs. */
  readonly straightM: number;
  readonly horizontalM: number;
  /** From the first point to the last. */
  readonly heightDifferenceM: number;
  readonly direct: Leg;
}

/** Below this the points are above one another, and have no direction: survey noise is larger. */
const VERTICAL_M = 1e-6;

/** Measure one leg. */
export function measureLeg(from: Vec3, to: Vec3): Leg {
  const east = to[0] - from[0];
  const riseM = to[1] - from[1];
  const south = to[2] - from[2];
  const horizontalM = Math.hypot(east, south);
  const isVertical = horizontalM < VERTICAL_M;
  return {
    straightM: Math.hypot(east, riseM, south),
    horizontalM,
    heightDifferenceM: riseM,
    slopeDeg: isVertical && riseM === 0 ? 0 : degrees(Math.atan2(riseM, horizontalM)),
    azimuthDeg: isVertical ? null : (degrees(Math.atan2(east, -south)) + 360) % 360,
  };
}

/** Measure a path; null below two points. */
export function measurePath(points: readonly Vec3[]): Measurement | null {
  const first = points[0];
  const last = points[points.length - 1];
  if (first === undefined || last === undefined || points.length < 2) return null;
  const legs = points.slice(1).map((point, index) => measureLeg(points[index]!, point));
  return {
    legs,
    straightM: legs.reduce((sum, leg) => sum + leg.straightM, 0),
    horizontalM: legs.reduce((sum, leg) => sum + leg.horizontalM, 0),
    heightDifferenceM: last[1] - first[1],
    direct: measureLeg(first, last),
  };
}

function degrees(radians: number): number {
  return (radians * 180) / Math.PI;
}
