import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import { BYTES, facts, plan } from "./residency-plans.ts";

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

/** Decode and upload whatever is asked for until nothing is. Returns what was asked for. */
function work(except: readonly number[] = []): number[] {
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

function land(
  landing: number,
  load: readonly number[],
  keep: readonly number[] = [],
  nearby: readonly number[] = [],
): void {
  residency.land(landing, [0, 0, 0], 60, 0);
  residency.planned(plan(landing, load, keep, nearby));
  for (const segment of load) {
    residency.arrived(facts(segment), landing);
  }
  residency.ready(
    landing,
    [...load, ...keep].sort((a, b) => a - b),
    [],
    5,
    load.length * 10,
  );
}

describe("a landing", () => {
  it("is presentable when all of it and the base are on the GPU, and shown by swap alone", () => {
    residency.land(1, [1, 2, 3], 60, 1000);
    expect(residency.coming).toBeNull();
    residency.planned(plan(1, [7, 3]));
    expect(residency.coming).toEqual([3, 7]);
    expect(residency.takeDecodes()).toEqual([]);
    residency.arrived(facts(7), 1);
    residency.arrived(facts(3), 1);
    expect(residency.takeDecodes()).toEqual([
      { segment: 7, epoch: 0 },
      { segment: 3, epoch: 0 },
    ]);
    residency.ready(1, [3, 7], [], 250, 20);
    expect(residency.decoded(7, 0, BYTES)).toBe(true);
    expect(residency.nextUpload()).toBe(7);
    residency.uploaded(7);
    residency.warmed(7);
    expect(residency.fraction()).toBe(0.75);
    residency.decoded(3, 0, BYTES);
    residency.uploaded(3);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull(); // 3 was not drawn yet.
    residency.warmed(3);
    expect(residency.presentable()).toBe("full");
    residency.settle(1300);
    expect(residency.newest?.presentableMs).toBe(300);
    expect(residency.newest?.readyMs).toBe(250);
    expect(residency.visible).toEqual([]);
    expect(residency.swap()).toEqual({ landing: 1, degraded: false, visible: [3, 7], shown: [3, 7], hidden: [] });
    expect(residency.visible).toEqual([3, 7]);
    expect(residency.swap()).toBeNull();
  });

  it("waits for the base", () => {
    land(1, [1]);
    const revision = residency.comingRevision;
    work();
    residency.basePrepared(revision - 1);
    expect(residency.presentable()).toBeNull();
    residency.basePrepared(revision);
    expect(residency.presentable()).toBe("full");
  });

  it("shows only what is new, hides what is left, and keeps it while there is room", () => {
    land(1, [1, 2, 3]);
    work();
    residency.swap();
    land(2, [4], [3]);
    expect(work()).toEqual([4]);
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.swap()).toMatchObject({ shown: [4], hidden: [1, 2], visible: [3, 4] });
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.spareBytes).toBe(2 * BYTES);
    land(3, [5]);
    work();
    expect(residency.swap()).toMatchObject({ hidden: [3, 4] });
    // What was left first goes first.
    expect(residency.takeFreed()).toEqual([1]);
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.spareBytes).toBe(3 * BYTES);
  });

  it("shows what it left in the next frame, with nothing to decode or upload", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    land(2, [3]);
    work();
    residency.swap();
    land(3, [], [1, 2]);
    expect(residency.takeDecodes()).toEqual([]);
    expect(residency.nextUpload()).toBeNull();
    residency.basePrepared(residency.comingRevision);
    expect(residency.swap()).toMatchObject({ shown: [1, 2], hidden: [3] });
  });

  it("asks again for what was freed, without any payload", () => {
    residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 0 });
    land(1, [1]);
    work();
    residency.swap();
    land(2, [2]);
    work();
    residency.swap();
    land(3, [], [1]);
    expect(work()).toEqual([1]);
    expect(residency.fraction()).toBe(1);
    expect(residency.swap()).toMatchObject({ shown: [1], hidden: [2] });
  });

  it("keeps on the GPU what is nearby, hidden, and shows it again at once", () => {
    land(1, [1, 2, 3]);
    work();
    residency.swap();
    land(2, [4], [1], [2]);
    work();
    expect(residency.swap()).toMatchObject({ visible: [1, 4], hidden: [2, 3] });
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.spareBytes).toBe(BYTES);
    land(3, [], [1, 2], [4]);
    expect(work()).toEqual([]);
    expect(residency.swap()).toMatchObject({ visible: [1, 2], shown: [2], hidden: [4] });
    land(4, [5]);
    work();
    residency.swap();
    expect(residency.takeFreed()).toEqual([3]);
    expect(residency.spareBytes).toBe(3 * BYTES);
  });

  it("decodes nothing for the sake of what is nearby", () => {
    residency.arrived(facts(2), 1);
    land(2, [4], [], [2, 9]);
    expect(work()).toEqual([4]);
  });

  it("of an empty place hides everything", () => {
    land(1, [1]);
    work();
    residency.swap();
    land(2, []);
    work();
    expect(residency.swap()).toMatchObject({ visible: [], hidden: [1] });
  });

  it("goes by ready where it differs from the plan", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1, 2]));
    residency.arrived(facts(1), 1);
    const revision = residency.comingRevision;
    residency.ready(1, [1], [2], 5, 10);
    expect(residency.comingRevision).toBeGreaterThan(revision);
    work();
    expect(residency.missing()).toEqual([2]);
    expect(residency.swap()?.visible).toEqual([1]);
  });

  it("that is refused leaves what is shown", () => {
    land(1, [1]);
    work();
    residency.swap();
    residency.land(2, [0, 0, 0], 60, 0);
    residency.refused(2, "radius too large");
    work();
    expect(residency.presentable()).toBeNull();
    expect(residency.visible).toEqual([1]);
    expect(residency.newest?.refusal).toBe("radius too large");
    expect(residency.takeFreed()).toEqual([]);
  });
});

describe("a deadline", () => {
  it("lets the inner part be shown, and the whole after it", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1, 2]));
    residency.arrived(facts(1), 1);
    residency.degraded(1, [1]);
    expect(residency.coming).toEqual([1]);
    work();
    expect(residency.presentable()).toBe("degraded");
    expect(residency.swap()).toMatchObject({ degraded: true, visible: [1] });
    expect(residency.presentable()).toBeNull();
    expect(residency.coming).toEqual([1, 2]);
    residency.arrived(facts(2), 1);
    residency.ready(1, [1, 2], [], 900, 20);
    work();
    expect(residency.swap()).toMatchObject({ degraded: false, shown: [2], hidden: [] });
  });

  it("does not free what the whole landing wants", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    residency.land(2, [0, 0, 0], 60, 0);
    residency.planned(plan(2, [3, 4], [2]));
    residency.arrived(facts(3), 2);
    residency.degraded(2, [3]);
    work();
    expect(residency.swap()).toMatchObject({ visible: [3], hidden: [1, 2] });
    expect(residency.takeFreed()).toEqual([]);
    expect(residency.spareBytes).toBe(BYTES);
  });

  it("is forgotten when ready comes before the swap", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1, 2]));
    residency.arrived(facts(1), 1);
    residency.degraded(1, [1]);
    work();
    residency.arrived(facts(2), 1);
    residency.ready(1, [1, 2], [], 900, 20);
    expect(residency.presentable()).toBeNull();
    work();
    expect(residency.presentable()).toBe("full");
  });
});

describe("a newer landing", () => {
  it("supersedes: the old one's plan, ready and set count no more", () => {
    land(1, [1]);
    work();
    residency.land(2, [0, 0, 0], 60, 0);
    expect(residency.presentable()).toBeNull();
    expect(residency.swap()).toBeNull();
    residency.ready(1, [1], [], 5, 10);
    residency.degraded(1, [1]);
    residency.planned(plan(1, [1]));
    expect(residency.coming).toBeNull();
    residency.planned(plan(2, [2]));
    expect(residency.coming).toEqual([2]);
  });

  it("drops meshes that wait for what nobody wants any more, and keeps those that it wants", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1, 2]));
    residency.arrived(facts(1), 1);
    residency.arrived(facts(2), 1);
    for (const { segment, epoch } of residency.takeDecodes()) {
      residency.decoded(segment, epoch, BYTES);
    }
    residency.land(2, [0, 0, 0], 60, 0);
    expect(residency.takeFreed()).toEqual([]);
    residency.planned(plan(2, [], [2]));
    expect(residency.takeFreed()).toEqual([1]);
    expect(residency.nextUpload()).toBe(2);
    expect(residency.inFlight).toBe(1);
  });

  it("throws a mesh away that comes after its landing is gone", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1]));
    residency.arrived(facts(1), 1);
    residency.takeDecodes();
    residency.land(2, [0, 0, 0], 60, 0);
    residency.planned(plan(2, []));
    expect(residency.decoded(1, 0, BYTES)).toBe(false);
    expect(residency.inFlight).toBe(0);
  });
});

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

describe("a segment that cannot be decoded", () => {
  it("is missing, and its base faces are not hidden", () => {
    land(1, [1, 2]);
    work([2]);
    expect(residency.coming).toEqual([1]);
    expect(residency.missing()).toEqual([2]);
    expect(residency.presentable()).toBe("full");
    expect(residency.swap()?.visible).toEqual([1]);
  });

  it("is tried once more when it comes once more", () => {
    land(1, [1]);
    work([1]);
    residency.arrived(facts(1), 1);
    expect(residency.coming).toEqual([1]);
    expect(work()).toEqual([1]);
    expect(residency.swap()?.visible).toEqual([1]);
  });

  it("is the same when the cache dropped it before", () => {
    land(1, [1, 2]);
    residency.dropped([2]);
    expect(work()).toEqual([1]);
    expect(residency.missing()).toEqual([2]);
    expect(residency.swap()?.visible).toEqual([1]);
  });
});

describe("a reconnect", () => {
  it("that declares the same set again asks for no swap", () => {
    land(1, [1]);
    work();
    residency.swap();
    residency.planned(plan(1, [], [1]));
    residency.ready(1, [1], [], 5, 0);
    expect(work()).toEqual([]);
    expect(residency.presentable()).toBeNull();
    expect(residency.newest?.swapped).toBe("full");
  });

  it("to a new version forgets all, drops answers of the old, and shows nothing until the new base is here", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    residency.land(2, [0, 0, 0], 60, 0);
    residency.planned(plan(2, [3]));
    residency.arrived(facts(3), 2);
    const [request] = residency.takeDecodes();
    residency.versionChanged();
    expect(residency.visible).toEqual([1, 2]);
    expect(residency.decoded(3, request!.epoch, BYTES)).toBe(false);
    expect(residency.inFlight).toBe(0);
    residency.planned(plan(2, [1]));
    residency.arrived(facts(1), 2);
    expect(residency.takeDecodes()).toEqual([{ segment: 1, epoch: 1 }]);
    residency.clearVisible();
    expect(residency.visible).toEqual([]);
    residency.decoded(1, 1, BYTES);
    residency.uploaded(1);
    residency.warmed(1);
    residency.ready(2, [1], [], 5, 10);
    residency.basePrepared(residency.comingRevision);
    expect(residency.swap()?.visible).toEqual([1]);
  });
});

describe("a lost context", () => {
  it("uploads the visible set again before anything else, and shows it when all of it is back", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    residency.land(2, [0, 0, 0], 60, 0);
    residency.planned(plan(2, [3]));
    residency.arrived(facts(3), 2);
    residency.contextLost();
    expect(residency.restoring).toBe(true);
    expect(residency.visible).toEqual([1, 2]);
    expect(residency.restorable()).toBeNull();
    expect(residency.presentable()).toBeNull();
    expect(work()).toEqual([1, 2, 3]);
    expect(residency.restorable()).toEqual([1, 2]);
    residency.restored();
    expect(residency.restoring).toBe(false);
    expect(residency.visible).toEqual([1, 2]);
    expect(residency.takeFreed()).toEqual([]);
  });

  it("takes what cannot be decoded again out of the visible set: no hole may stay there", () => {
    land(1, [1, 2]);
    work();
    residency.swap();
    residency.contextLost();
    work([2]);
    expect(residency.restorable()).toEqual([1]);
    residency.restored();
    expect(residency.visible).toEqual([1]);
  });

  it("forgets half-uploaded meshes", () => {
    residency.land(1, [0, 0, 0], 60, 0);
    residency.planned(plan(1, [1]));
    residency.arrived(facts(1), 1);
    residency.takeDecodes();
    residency.decoded(1, 0, BYTES);
    residency.contextLost();
    expect(residency.inFlight).toBe(0);
    expect(residency.restoring).toBe(false);
    expect(residency.takeDecodes()).toEqual([{ segment: 1, epoch: 0 }]);
  });
});
