/** A scene small enough to check by brute force: 81 segments of 1 m in the plane y = 0, with gaps of 1 m. */

import type { Bounds, SegmentKey, Vec3 } from "../../src/core/types.ts";

const GRID = 9;
export const MIDDLE: Vec3 = [GRID, 0, GRID];

export interface ToySegment {
  readonly key: SegmentKey;
  readonly bounds: Bounds;
  readonly payload: Uint8Array<ArrayBuffer>;
}

export const TOY: readonly ToySegment[] = Array.from({ length: GRID * GRID }, (_, segment) => {
  const [x, z] = [2 * (segment % GRID), 2 * Math.floor(segment / GRID)];
  const key = (segment + 1).toString(16).padStart(16, "0");
  return { key, bounds: [x, 0, z, x + 1, 0, z + 1] as const, payload: new Uint8Array(100 + segment).fill(segment) };
});

/** The segments that a landing shows. */
export function toyWithin(centre: readonly number[], radiusM: number): readonly ToySegment[] {
  const gap = (bounds: Bounds, axis: 0 | 1 | 2) =>
    Math.max(bounds[axis] - centre[axis]!, 0, centre[axis]! - bounds[axis + 3]!);
  return TOY.filter(({ bounds }) => Math.hypot(gap(bounds, 0), gap(bounds, 1), gap(bounds, 2)) <= radiusM);
}
