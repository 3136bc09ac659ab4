/** Plans for the tests of residency. Keys are single letters here: "abc" are three segments. */

import type { Residency } from "../src/core/residency.ts";
import type { FaceBits, PlanFacts, SegmentFacts, SegmentKey } from "../src/core/types.ts";

/** Of every mesh on the GPU. */
export const BYTES = 100;

export function facts(key: SegmentKey, follows: boolean): SegmentFacts {
  return { key, segment: key.charCodeAt(0), isCoarser: false, bytes: 10, faces: 1, vertices: 3, follows };
}

/** Hidden faces of a set, another one for each set. */
export function bitsOf(keys: string): FaceBits {
  return Uint8Array.from([...keys].sort(), (key) => key.charCodeAt(0));
}

/** The plan of a landing, of which the segments in `load` follow and those in `held` are here. */
export function plan(landing: number, load: string, held = ""): PlanFacts {
  const show = [...[...load].map((key) => facts(key, true)), ...[...held].map((key) => facts(key, false))];
  return {
    landing,
    position: [0, 0, 0],
    radiusM: 60,
    effectiveRadiusM: 60,
    coarseRadiusM: null,
    show,
    hidden: bitsOf(load + held),
    loadBytes: load.length * 10,
    totalBytes: show.length * 10,
    totalTriangles: 0,
    omittedSegments: 0,
    omittedBy: null,
  };
}

/** Decode and upload whatever is asked for until nothing is. Returns what was asked for. */
export function workOn(residency: Residency, failing = ""): string {
  let requested = "";
  for (;;) {
    const requests = residency.takeDecodes();
    for (const { segment, epoch } of requests) {
      requested += segment;
      if (failing.includes(segment)) residency.decodeFailed(segment, epoch);
      else residency.decoded(segment, epoch, BYTES);
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

/** What the stream says of a landing that was asked for. */
export function answerTo(residency: Residency, landing: number, load: string, held = ""): void {
  residency.planned(plan(landing, load, held));
  for (const key of load) residency.arrived(key, 10, landing);
  const visible = [...(load + held)];
  residency.ready(landing, visible, bitsOf(load + held), [], 5, load.length * 10);
}
