/** Plans for the tests of residency. */

import type { Residency } from "../src/core/residency.ts";
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

/** Decode and upload whatever is asked for until nothing is. Returns what was asked for. */
export function workOn(residency: Residency, except: readonly number[] = []): number[] {
  const requested: number[] = [];
  for (;;) {
    const requests = residency.takeDecodes();
    for (const { segment, epoch } of requests) {
      requested.push(segment);
      if (except.includes(segment)) {
        residency.decodeFailed(segment, epoch);
      } else {
        residency.decoded(segment, epoch, BYTES);
      }
    }
    for (let next = residency.nextUpload(); next !== null; next = residency.nextUpload()) {
      residency.uploaded(next);
      residency.warmed(next);
    }
    if (requests.length === 0) {
      residency.basePrepared(residency.comingRevision);
      return requested;
    }
  }
}

/** A landing's number; what its plan loads, keeps, and has nearby. */
export type LandingTold = [number, readonly number[], (readonly number[])?, (readonly number[])?];

/** A landing, and all that the service says of it. */
export function landOn(residency: Residency, ...told: LandingTold): void {
  const [landing] = told;
  residency.land(landing, [0, 0, 0], 60, 0);
  answerTo(residency, ...told);
}

/** What the service says of a landing that was asked for. */
export function answerTo(residency: Residency, ...[landing, load, keep = [], nearby = []]: LandingTold): void {
  residency.planned(plan(landing, load, keep, nearby));
  for (const segment of load) {
    residency.arrived(facts(segment), landing);
  }
  const visible = [...load, ...keep].sort((a, b) => a - b);
  residency.ready(landing, visible, [], 5, load.length * 10);
}
