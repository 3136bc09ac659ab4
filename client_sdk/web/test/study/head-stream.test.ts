import { describe, expect, it } from "vitest";

import { Residency } from "../../src/core/residency.ts";
import { passOn } from "../../src/core/residency-events.ts";
import type { PlanFacts, SegmentFacts, Stream, StreamEvent, Vec3 } from "../../src/core/types.ts";
import { HeadStream } from "../../src/study/head-stream.ts";
import { cell, looking } from "./cells.ts";

const OPTIONS = { baseErrorM: 0.2, maxErrorPx: 10, budgets: {} };
const AHEAD = [cell(1, 0, -5), cell(2, 0, -3)];
const BEHIND = [cell(3, 0, 3), cell(4, 0, 5)];

/** A stream that a test speaks for. */
class ToldStream {
  onEvent: (event: StreamEvent) => void = () => undefined;
  readonly aims: Vec3[] = [];
  #landing = 0;
  land(): number {
    this.#landing += 1;
    return this.#landing;
  }
  aim(position: Vec3): void {
    this.aims.push(position);
  }
}

function planOf(landing: number, load: readonly SegmentFacts[]): PlanFacts {
  return {
    landing,
    position: [0, 0, 0],
    radiusM: 10,
    effectiveRadiusM: 10,
    coarseRadiusM: null,
    load,
    keep: [],
    nearby: [],
    loadBytes: 0,
    totalBytes: 0,
    totalTriangles: 0,
    omittedSegments: 0,
    omittedBy: null,
  };
}

/** The follower over a told stream, with a residency that hears it, and everything put on the "GPU" at once. */
function landed(cells: readonly SegmentFacts[]) {
  const told = new ToldStream();
  const stream = new HeadStream(told as unknown as Stream);
  const residency = new Residency({ maxInFlight: 100, maxInFlightBytes: 1e9, spareBytes: 1e9 });
  stream.onEvent = (event) => passOn(event, residency);
  const landing = stream.land([0, 0, 0], 10);
  residency.land(landing, [0, 0, 0], 10, 0);
  const settle = () => {
    for (const { segment, epoch } of residency.takeDecodes()) {
      residency.decoded(segment, epoch, 10);
      residency.uploaded(segment);
      residency.warmed(segment);
    }
    residency.basePrepared(residency.comingRevision);
    return residency.swap();
  };
  told.onEvent({ type: "planned", plan: planOf(landing, cells) });
  for (const facts of cells) told.onEvent({ type: "arrived", landing, facts });
  const ids = cells.map(({ segment }) => segment);
  told.onEvent({
    type: "ready",
    landing,
    visible: ids,
    missing: [],
    elapsedMs: 1,
    readyAtMs: 1,
    payloadBytes: 4000,
  });
  settle();
  return { told, stream, residency, landing, settle };
}

describe("the baseline", () => {
  it("shows a landing whole, as the product does", () => {
    expect(landed([...AHEAD, ...BEHIND]).residency.visible).toEqual([1, 2, 3, 4]);
  });

  it("changes what is shown when the head turns, and back again", () => {
    const { stream, residency, settle } = landed([...AHEAD, ...BEHIND]);
    expect(stream.follow(looking(true), residency.visible, OPTIONS)).toBe(true);
    expect(settle()?.hidden).toEqual([3, 4]);
    expect(residency.visible).toEqual([1, 2]);
    expect(stream.follow(looking(false), residency.visible, OPTIONS)).toBe(true);
    settle();
    expect(residency.visible).toEqual([3, 4]);
  });

  it("declares nothing where the head rests", () => {
    const { stream, residency, settle } = landed(AHEAD);
    expect(stream.follow(looking(true), residency.visible, OPTIONS)).toBe(false);
    expect(settle()).toBeNull();
  });

  it("keeps what is behind on the GPU", () => {
    const { stream, residency, settle } = landed([...AHEAD, ...BEHIND]);
    stream.follow(looking(true), residency.visible, OPTIONS);
    settle();
    expect(residency.takeFreed()).toEqual([]);
  });

  it("asks for payload where the eye goes, and shows what comes", () => {
    const { told, stream, residency, settle } = landed(AHEAD);
    stream.follow(looking(true, -1), residency.visible, OPTIONS);
    expect(told.aims).toEqual([]);
    stream.follow(looking(true, -8), residency.visible, OPTIONS);
    expect(told.aims).toEqual([[0, 0, -8]]);
    settle();
    told.onEvent({ type: "arrived", landing: null, facts: cell(9, 0, -12) });
    expect(stream.follow(looking(true, -8), residency.visible, OPTIONS)).toBe(true);
    settle();
    expect(residency.visible).toEqual([9]);
  });

  it("begins so many at once and no more", () => {
    const many = Array.from({ length: 40 }, (_, index) => cell(100 + index, 0, 2 + index * 0.1));
    const { stream, residency, settle } = landed([...AHEAD, ...many]);
    stream.follow(looking(true), residency.visible, OPTIONS);
    settle();
    stream.follow(looking(false), residency.visible, OPTIONS);
    settle();
    expect(residency.visible.length).toBe(16);
    while (stream.follow(looking(false), residency.visible, OPTIONS)) settle();
    expect(residency.visible.length).toBe(40);
  });

  it("leaves a landing that is under way alone", () => {
    const { stream, residency } = landed([...AHEAD, ...BEHIND]);
    stream.land([50, 0, 0], 10);
    expect(stream.follow(looking(true), residency.visible, OPTIONS)).toBe(false);
  });

  it("forgets what the cache let go", () => {
    const { told, stream, residency, settle } = landed([...AHEAD, ...BEHIND]);
    stream.follow(looking(true), residency.visible, OPTIONS);
    settle();
    told.onEvent({ type: "dropped", segments: [3, 4] });
    stream.follow(looking(false), residency.visible, OPTIONS);
    settle();
    expect(residency.visible).toEqual([]);
  });
});
