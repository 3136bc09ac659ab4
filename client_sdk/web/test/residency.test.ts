import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import { BYTES, facts, type LandingTold, landOn, plan, workOn } from "./residency-plans.ts";

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

const work = (except?: readonly number[]) => workOn(residency, except);
const land = (...landing: LandingTold) => landOn(residency, ...landing);

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
