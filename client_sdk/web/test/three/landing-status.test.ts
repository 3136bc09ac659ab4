import { describe, expect, it } from "vitest";

import { Residency } from "../../src/core/residency.ts";
import type { PlanFacts, SegmentFacts } from "../../src/core/types.ts";
import { statusOf } from "../../src/three/landing-status.ts";

const KEY = "a";
const HIDDEN = Uint8Array.of(1);
const SEGMENT: SegmentFacts = {
  key: KEY,
  segment: 4,
  isCoarser: false,
  bytes: 10,
  faces: 1,
  vertices: 3,
  follows: true,
};
const PLAN: PlanFacts = {
  landing: 1,
  position: [1, 2, 3],
  radiusM: 60,
  effectiveRadiusM: 60,
  coarseRadiusM: null,
  show: [SEGMENT],
  hidden: HIDDEN,
  loadBytes: 10,
  totalBytes: 10,
  totalTriangles: 1,
  omittedSegments: 0,
  omittedBy: null,
};

function landed(): Residency {
  const residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 0 });
  residency.land(1, [1, 2, 3], 60, 0);
  return residency;
}

function upload(residency: Residency): void {
  residency.arrived(KEY, 10, 1);
  residency.takeDecodes();
  residency.decoded(KEY, residency.epoch, 100);
  residency.uploaded(KEY);
  residency.warmed(KEY);
  residency.basePrepared(residency.comingRevision);
}

describe("the status of a landing", () => {
  it("goes from idle to shown", () => {
    const residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 0 });
    expect(statusOf(residency, true)).toMatchObject({ landing: 0, phase: "idle", fraction: 0, plan: null });
    residency.land(1, [1, 2, 3], 60, 0);
    expect(statusOf(residency, true)).toMatchObject({
      landing: 1,
      phase: "planning",
      position: [1, 2, 3],
      radiusM: 60,
    });
    residency.planned(PLAN);
    expect(statusOf(residency, true)).toMatchObject({ phase: "streaming", fraction: 0, plan: PLAN });
    upload(residency);
    expect(statusOf(residency, true)).toMatchObject({
      phase: "streaming",
      fraction: 1,
      payloadBytes: 10,
      readyMs: null,
    });
    residency.ready(1, [KEY], HIDDEN, [], 70, 10);
    residency.settle(90);
    expect(statusOf(residency, true)).toMatchObject({ phase: "presentable", readyMs: 70, presentableMs: 90 });
    residency.swap();
    expect(statusOf(residency, true).phase).toBe("shown");
  });

  it("is not presentable while nothing can be shown", () => {
    const residency = landed();
    residency.planned(PLAN);
    residency.ready(1, [KEY], HIDDEN, [], 70, 10);
    upload(residency);
    expect(statusOf(residency, false).phase).toBe("streaming");
    expect(statusOf(residency, true).phase).toBe("presentable");
  });

  it("streams on after the inner part was shown", () => {
    const residency = landed();
    residency.planned({ ...PLAN, show: [SEGMENT, { ...SEGMENT, key: "b" }] });
    residency.degraded(1, [KEY], HIDDEN);
    upload(residency);
    expect(statusOf(residency, true).phase).toBe("degraded-presentable");
    residency.swap();
    expect(statusOf(residency, true).phase).toBe("streaming");
  });

  it("says why it was refused", () => {
    const residency = landed();
    residency.refused(1, "radius too large");
    expect(statusOf(residency, true)).toMatchObject({ phase: "refused", refusal: "radius too large" });
  });
});
