/** Segments and heads of the tests. */

import type { HeadView, PlacedSegment } from "../../src/study/screen-error.ts";

/** A segment of 1 m at (x, 0, z). */
export function cell(segment: number, x: number, z: number, faces = 100): PlacedSegment {
  const bounds = [x, 0, z, x + 1, 1, z + 1] as const;
  return { key: `key ${segment}`, segment, isCoarser: false, bytes: 1000, faces, vertices: 60, follows: true, bounds };
}

/** Sees what lies ahead of the eye, towards -z, or behind it. */
export function looking(ahead: boolean, z = 0): HeadView {
  const way = ahead ? -1 : 1;
  return { eye: [0, 0, z], planes: [{ normal: [0, 0, way], offset: -way * z }], pixelsPerMetre: 500 };
}
