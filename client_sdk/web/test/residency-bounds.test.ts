import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import { BYTES, facts, type LandingTold, landOn, plan, workOn } from "./residency-plans.ts";

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

const work = (except?: readonly number[]) => workOn(residency, except);
const land = (...landing: LandingTold) => landOn(residency, ...landing);

describe("bounds", () => {
  it("decodes so many at a time, in the plan's order", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [9, 8, 7, 6, 5, 4]));
    for (const segment of [4, 5, 6, 7, 8, 9]) {
      residency.arrived(facts(segment), 1);
    }
    expect(residency.takeDecodes().map(({ segment }) => segment)).toEqual([9, 8, 7, 6]);
    expect(residency.takeDecodes()).toEqual([]);
    residency.decoded(8, 0, BYTES);
    expect(residency.takeDecodes()).toEqual([]); // It waits for its upload.
    residency.uploaded(8);
    expect(residency.takeDecodes()).toEqual([{ segment: 5, epoch: 0 }]);
  });

  it("decodes fewer large ones, but always one", () => {
    residency = new Residency({ maxInFlight: 16, maxInFlightBytes: 40e6, spareBytes: 0 });
    const ids = Array.from({ length: 30 }, (_, id) => id);
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, ids));
    for (const id of ids) {
      residency.arrived(facts(id), 1);
    }
    let maxInFlight = 0;
    for (let round = 0; round < 30; round += 1) {
      const requests = residency.takeDecodes();
      expect(requests.length).toBeGreaterThan(0);
      maxInFlight = round > 8 ? Math.max(maxInFlight, requests.length) : 0;
      const first = requests[0]!;
      for (const { segment, epoch } of requests) {
        residency.decoded(segment, epoch, 22e6);
      }
      expect(first.segment).toBeGreaterThanOrEqual(0);
      for (let next = residency.nextUpload(); next !== null; next = residency.nextUpload()) {
        residency.uploaded(next);
      }
      if (residency.fraction() === 0.5 && round > 12) {
        break;
      }
    }
    expect(maxInFlight).toBeLessThanOrEqual(1);
  });

  it("keeps what an aim brought within the spare bytes, and what is wanted whatever it takes", () => {
    for (const segment of [1, 2, 3, 4, 5]) {
      residency.arrived(facts(segment), null);
    }
    work();
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.spareBytes).toBe(3 * BYTES);
    land(1, [], [1, 2, 3, 4, 5]);
    expect(work().sort()).toEqual([4, 5]);
    expect(residency.spareBytes).toBe(0);
    expect(residency.swap()?.visible).toEqual([1, 2, 3, 4, 5]);
    expect(residency.takeFreed()).toEqual([]);
  });

  it("remembers the newest 4096 of what aims brought, while there is no room for it", () => {
    residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: BYTES });
    residency.arrived(facts(0), null);
    expect(work()).toEqual([0]);
    for (let segment = 1; segment <= 4096 + 2; segment += 1) {
      residency.arrived(facts(segment), null);
    }
    expect(residency.takeDecodes()).toEqual([]);
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [], [0])); // 0 is spare no longer.
    expect(residency.takeDecodes().map((request) => request.segment)).toEqual([3, 4, 5, 6]);
  });

  it("frees what was left behind for what aims bring, and no aim for another", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    land(2, [3]);
    work();
    residency.swap();
    for (const segment of [4, 5, 6]) residency.arrived(facts(segment), null);
    expect(work()).toEqual([4, 5, 6]);
    residency.arrived(facts(7), null);
    expect(work()).toEqual([]);
    expect(residency.takeFreed()).toEqual([1, 2]);
    expect(residency.spareBytes).toBe(3 * BYTES);
    // After the next swap they are left behind like everything else.
    land(3, [8]);
    work();
    residency.swap();
    expect(residency.takeFreed()).toEqual([4]);
    residency.arrived(facts(9), null);
    expect(work()).toEqual([9]);
    expect(residency.takeFreed()).toEqual([5]);
  });

  it("puts a landing before any prefetch", () => {
    residency.arrived(facts(8), null);
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [5]));
    residency.arrived(facts(5), 1);
    expect(residency.takeDecodes().map(({ segment }) => segment)).toEqual([5, 8]);
    residency.decoded(8, 0, BYTES);
    residency.decoded(5, 0, BYTES);
    expect(residency.nextUpload()).toBe(5);
  });
});
