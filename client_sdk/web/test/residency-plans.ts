/** Plans for the tests of residency. */

import type { PlanFacts, SegmentFacts } from "../src/core/types.ts";

/** Of every mesh on the GPU. */
export const BYTES = 100;

/** What the index says of a segment. */
export function facts(segment: number): SegmentFacts {
  return { segment, length: 10, xxh3: 1n, faces: 1, vertices: 3, bounds: [0, 0, 0, 1, 1, 1] };
}

/** The plan of a landing. */
export function plan(
  landing: number,
  load: readonly number[],
  keep: readonly number[] = [],
  nearby: readonly number[] = [],
): PlanFacts {
  return {
    landing,
    position: [0, 0, 0],
    radiusM: 60,
    effectiveRadiusM: 60,
    coarseRadiusM: null,
    load: load.map(facts),
    keep,
    nearby,
    loadBytes: load.length * 10,
    totalBytes: (load.length + keep.length) * 10,
    totalTriangles: 0,
    omittedSegments: 0,
    omittedBy: null,
  };
}
