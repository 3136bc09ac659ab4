import { describe, expect, it } from "vitest";

import { Residency } from "../../src/core/residency.ts";
import { passOn } from "../../src/core/residency-events.ts";
import type { PlanFacts, Stream, StreamEvent, Vec3 } from "../../src/core/types.ts";
import { HeadStream } from "../../src/study/head-stream.ts";
import type { PlacedSegment } from "../../src/study/screen-error.ts";
import { cell, looking } from "./cells.ts";

const OPTIONS = { baseErrorM: 0.2, maxErrorPx: 10, budgets: {} };
const AHEAD = [cell(1, 0, -5), cell(2, 0, -3)];
const BEHIND = [cell(3, 0, 3), cell(4, 0, 5)];

/** A stream that a test speaks for. */
class ToldStream {
  onEvent: (event: StreamEvent) => void = () => undefined;
  readonly landings: Vec3[] = [];
  land(position: Vec3): number {
    this.landings.push(position);
    return this.landings.length;
  }
}

function planOf(landing: number, load: readonly PlacedSegment[]): PlanFacts {
  return {
    landing,
    position: [0, 0, 0],
    radiusM: 10,
    effectiveRadiusM: 10,
    coarseRadiusM: null,
    show: load,
    hidden: Uint8Array.of(1),
    loadBytes: 0,
    totalBytes: 0,
    totalTriangles: 0,
    omittedSegments: 0,
    omittedBy: null,
  };
}

/** The follower over a told stream, with a residency that hears it, and everything put on the "GPU" at once. */
function landed(cells: readonly PlacedSegment[]) {
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
  for (const facts of cells)
    told.onEvent({ type: "arrived", landing, key: facts.key, bytes: facts.bytes, bounds: facts.bounds });
  told.onEvent({
    type: "ready",
    landing,
    visible: cells.map(({ key }) => key),
    hidden: Uint8Array.of(1),
    missing: [],
    elapsedMs: 1,
    readyAtMs: 1,
    payloadBytes: 4000,
  });
  settle();
  /** Numbers of what is shown, ascending. */
  const visible = () =>
    residency.visible.map((key) => residency.factsOf(key)!.segment).sort((one, other) => one - other);
  return { told, stream, residency, landing, settle, visible };
}

describe("the baseline", () => {
  it("shows a landing whole, as the product does", () => {
    expect(landed([...AHEAD, ...BEHIND]).visible()).toEqual([1, 2, 3, 4]);
  });

  it("changes what is shown when the head turns, and back again", () => {
    const { stream, settle, visible } = landed([...AHEAD, ...BEHIND]);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(true);
    expect(settle()?.hidden).toEqual(["key 3", "key 4"]);
    expect(visible()).toEqual([1, 2]);
    expect(stream.follow(looking(false), visible(), OPTIONS)).toBe(true);
    settle();
    expect(visible()).toEqual([3, 4]);
  });

  it("declares nothing where the head rests", () => {
    const { stream, settle, visible } = landed(AHEAD);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(false);
    expect(settle()).toBeNull();
  });

  it("keeps what is behind on the GPU", () => {
    const { stream, residency, settle, visible } = landed([...AHEAD, ...BEHIND]);
    stream.follow(looking(true), visible(), OPTIONS);
    settle();
    expect(residency.takeFreed()).toEqual([]);
  });

  it("asks for payload where the eye goes, and shows what comes", () => {
    const { told, stream, settle, visible } = landed(AHEAD);
    stream.follow(looking(true, -1), visible(), OPTIONS);
    expect(told.landings).toHaveLength(1);
    stream.follow(looking(true, -8), visible(), OPTIONS);
    expect(told.landings[1]).toEqual([0, 0, -8]);
    settle();
    const { key, bytes, bounds, ...facts } = cell(9, 0, -12);
    told.onEvent({ type: "planned", plan: planOf(2, [{ key, bytes, bounds, ...facts }]) });
    told.onEvent({ type: "arrived", landing: 2, key, bytes, bounds });
    expect(stream.follow(looking(true, -8), visible(), OPTIONS)).toBe(true);
    settle();
    expect(visible()).toEqual([9]);
  });

  it("begins so many at once and no more", () => {
    const many = Array.from({ length: 40 }, (_, index) => cell(100 + index, 0, 2 + index * 0.1));
    const { stream, settle, visible } = landed([...AHEAD, ...many]);
    stream.follow(looking(true), visible(), OPTIONS);
    settle();
    stream.follow(looking(false), visible(), OPTIONS);
    settle();
    expect(visible().length).toBe(16);
    while (stream.follow(looking(false), visible(), OPTIONS)) settle();
    expect(visible().length).toBe(40);
  });

  it("leaves a landing that is under way alone", () => {
    const { stream, visible } = landed([...AHEAD, ...BEHIND]);
    stream.land([50, 0, 0], 10);
    expect(stream.follow(looking(true), visible(), OPTIONS)).toBe(false);
  });
});
