import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import type { Vec3 } from "../src/core/types.ts";
import { answerTo, BYTES, facts, type LandingTold, landOn, plan, workOn } from "./residency-plans.ts";

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

const work = () => workOn(residency);
const land = (...landing: LandingTold) => landOn(residency, ...landing);

describe("what a landing left", () => {
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
});

describe("the same landing once more", () => {
  const HERE: Vec3 = [1, 2, 3];
  const THERE: Vec3 = [40, 2, 3];
  const answer = (...told: LandingTold) => answerTo(residency, ...told);

  function show(landing: number, at: Vec3, load: readonly number[], keep: readonly number[] = []): void {
    residency.land(landing, at, 60, 0);
    answer(landing, load, keep);
    work();
    expect(residency.swap()).not.toBeNull();
  }

  beforeEach(() => {
    show(1, HERE, [1, 2]);
    show(2, THERE, [3], [2]);
    residency.land(3, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
  });

  it("is shown before the service has answered, and the answer changes nothing", () => {
    expect(residency.swap()).toMatchObject({ landing: 3, degraded: false, shown: [1], hidden: [3] });
    expect(residency.newest).toMatchObject({ readyMs: null, plan: { landing: 3, load: [], keep: [1, 2] } });
    answer(3, [], [1, 2], [3]);
    work();
    expect(residency.presentable()).toBeNull();
    expect(residency.newest).toMatchObject({ readyMs: 5, swapped: "full", plan: { nearby: [3] } });
    expect(residency.visible).toEqual([1, 2]);
  });

  it("may be shown in the middle of the answer: eyes that close for it need not close twice", () => {
    expect(residency.presentable()).toBe("full");
    residency.planned(plan(3, [], [1, 2]));
    expect(residency.presentable()).toBe("full");
    residency.ready(3, [1, 2], [], 5, 0);
    expect(residency.swap()).toMatchObject({ shown: [1], hidden: [3] });
    expect(residency.presentable()).toBeNull();
  });

  it("goes by the answer where that says otherwise", () => {
    residency.swap();
    answer(3, [4], [2]);
    work();
    expect(residency.swap()).toMatchObject({ landing: 3, visible: [2, 4], shown: [4], hidden: [1] });
    // And so the next time.
    show(4, THERE, [], [2, 3]);
    residency.land(5, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.swap()).toMatchObject({ visible: [2, 4] });
  });

  it("waits for the answer that takes it back before it was shown", () => {
    residency.planned(plan(3, [4], [2]));
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it("keeps what it shows where the service refuses", () => {
    residency.swap();
    residency.refused(3, "too many");
    work();
    expect(residency.presentable()).toBeNull();
    expect(residency.visible).toEqual([1, 2]);
  });

  it.each([
    ["another radius", HERE, 59, {}],
    ["a centimetre beside", [1.01, 2, 3], 60, {}],
    ["with a ring", HERE, 60, { coarseRadiusM: 180 }],
  ] as const)("is another one: %s", (_, at, radiusM, options) => {
    residency.land(4, at, radiusM, 0, options);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it("is asked anew in another session, of another version, and where something is no longer on the GPU", () => {
    for (const forget of [
      () => residency.sessionOpened(),
      () => residency.versionChanged(),
      () => residency.contextLost(),
    ]) {
      residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
      show(1, HERE, [1, 2]);
      show(2, THERE, [3], [2]);
      forget();
      residency.land(3, HERE, 60, 0);
      residency.basePrepared(residency.comingRevision);
      expect(residency.presentable()).toBeNull();
    }
  });

  it("is remembered only as it was shown whole", () => {
    residency.land(4, [9, 9, 9], 60, 0);
    residency.planned(plan(4, [7, 8]));
    residency.arrived(facts(7), 4);
    residency.ready(4, [7], [8], 5, 10);
    work();
    expect(residency.swap()).toMatchObject({ visible: [7] });
    residency.land(5, HERE, 60, 0);
    residency.land(6, [9, 9, 9], 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it("is forgotten after 32 others", () => {
    for (let other = 0; other < 31; other += 1) show(10 + other, [other, 99, 0], [], [2]);
    residency.land(50, THERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBe("full");
    residency.land(51, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });
});
