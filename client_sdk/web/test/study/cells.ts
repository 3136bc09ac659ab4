/** Segments and heads of the tests. */

import type { SegmentFacts } from "../../src/core/types.ts";
import type { HeadView } from "../../src/study/screen-error.ts";

/** A segment of 1 m at (x, 0, z). */
export function cell(segment: number, x: number, z: number, faces = 100): SegmentFacts {
  return { segment, length: 1000, xxh3: 0n, faces, vertices: 60, bounds: [x, 0, z, x + 1, 1, z + 1] };
}

/** Sees what lies ahead of the eye, towards -z, or behind it. */
export function looking(ahead: boolean, z = 0): HeadView {
  const way = ahead ? -1 : 1;
  return { eye: [0, 0, z], planes: [{ normal: [0, 0, way], offset: -way * z }], pixelsPerMetre: 500 };
}
