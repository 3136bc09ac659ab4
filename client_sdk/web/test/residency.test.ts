import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import type { PlanFacts, Vec3 } from "../src/core/types.ts";
import { random } from "./random.ts";
import { answerTo, BYTES, bitsOf, plan, workOn } from "./residency-plans.ts";

const HERE: Vec3 = [1, 2, 3];
const THERE: Vec3 = [40, 2, 3];

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

const work = (failing?: string) => workOn(residency, failing);

function land(landing: number, load: string, held?: string, at: Vec3 = [0, 0, landing]): void {
  residency.land(landing, at, 60, 0);
  answerTo(residency, landing, load, held);
}

function show(landing: number, load: string, held?: string, at?: Vec3): void {
  land(landing, load, held, at);
  work();
  expect(residency.swap()).not.toBeNull();
}

/** Keys in one string, in alphabetical order. */
const text = (keys: readonly string[] | undefined) => [...(keys ?? [])].sort().join("");

describe("a landing", () => {
  it("is presentable when all of it and the base are on the GPU, and shown by swap alone", () => {
    residency.land(1, HERE, 60, 1000);
    expect(residency.coming).toBeNull();
    residency.planned(plan(1, "ba"));
    expect(residency.coming).toMatchObject({ segments: ["b", "a"], hidden: bitsOf("ab") });
    expect(residency.takeDecodes()).toEqual([]);
    residency.arrived("b", 10, 1);
    residency.arrived("a", 10, 1);
    expect(residency.takeDecodes().map(({ segment }) => segment)).toEqual(["b", "a"]);
    residency.ready(1, ["b", "a"], bitsOf("ab"), [], 250, 20);
    for (const key of ["b", "a"]) {
      expect(residency.decoded(key, 0, BYTES)).toBe(true);
      expect(residency.nextUpload()).toBe(key);
      residency.uploaded(key);
      residency.basePrepared(residency.comingRevision);
      expect(residency.presentable()).toBeNull(); // It was not drawn yet.
      residency.warmed(key);
    }
    expect(residency.presentable()).toBe("full");
    residency.settle(1300);
    expect(residency.newest).toMatchObject({ presentableMs: 300, readyMs: 250 });
    expect(residency.visible).toEqual([]);
    expect(residency.swap()).toMatchObject({ landing: 1, degraded: false, shown: ["b", "a"], hidden: [] });
    expect(text(residency.visible)).toBe("ab");
    expect(residency.swap()).toBeNull();
  });

  it("waits for the base", () => {
    land(1, "a");
    const revision = residency.comingRevision;
    work();
    residency.basePrepared(revision - 1);
    expect(residency.presentable()).toBeNull();
    residency.basePrepared(revision);
    expect(residency.presentable()).toBe("full");
  });

  it("shows only what is new, hides what is left, and keeps it while there is room", () => {
    show(1, "abc");
    land(2, "d", "c");
    expect(work()).toBe("d");
    expect(residency.swap()).toMatchObject({ shown: ["d"], hidden: ["a", "b"] });
    expect(residency.takeFreed()).toEqual([]);
    show(3, "e");
    expect(residency.takeFreed()).toEqual(["a"]); // What was left first goes first.
    expect(residency.spareBytes).toBe(3 * BYTES);
    land(4, "", "a");
    expect(work()).toBe("a"); // Decoded again from its payload.
  });

  it("goes by ready where it differs from the plan", () => {
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "ab"));
    residency.arrived("a", 10, 1);
    const revision = residency.comingRevision;
    residency.ready(1, ["a"], bitsOf("a"), ["b"], 5, 10);
    expect(residency.comingRevision).toBeGreaterThan(revision);
    work();
    expect(residency.newest?.missing).toEqual(["b"]);
    expect(residency.swap()?.visible).toEqual(["a"]);
  });

  it("that is refused leaves what is shown", () => {
    show(1, "a");
    residency.land(2, HERE, 60, 0);
    residency.refused(2, "radius too large");
    work();
    expect(residency.presentable()).toBeNull();
    expect(residency.visible).toEqual(["a"]);
    expect(residency.newest?.refusal).toBe("radius too large");
  });

  it("supersedes the one before: its plan, ready and set count no more", () => {
    land(1, "a");
    work();
    residency.land(2, HERE, 60, 0);
    expect(residency.swap()).toBeNull();
    answerTo(residency, 1, "a");
    expect(residency.coming).toBeNull();
    residency.planned(plan(2, "b"));
    expect(residency.coming?.segments).toEqual(["b"]);
  });

  it("drops meshes that wait for what nobody wants any more, and keeps those that it wants", () => {
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "abc"));
    for (const key of "abc") residency.arrived(key, 10, 1);
    const requests = residency.takeDecodes();
    for (const key of "ab") residency.decoded(key, 0, BYTES);
    residency.land(2, THERE, 60, 0);
    expect(residency.takeFreed()).toEqual([]);
    residency.planned(plan(2, "", "b"));
    expect(residency.takeFreed()).toEqual(["a"]);
    expect(residency.nextUpload()).toBe("b");
    expect(requests.at(-1)?.segment).toBe("c");
    expect(residency.decoded("c", 0, BYTES)).toBe(false);
  });
});

describe("a landing that takes long", () => {
  it("lets the inner part be shown, and the whole after it", () => {
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "ab"));
    residency.arrived("a", 10, 1);
    residency.degraded(1, ["a"], bitsOf("a"));
    expect(residency.coming).toMatchObject({ segments: ["a"], hidden: bitsOf("a") });
    work();
    expect(residency.swap()).toMatchObject({ degraded: true, visible: ["a"] });
    expect(residency.coming?.segments).toEqual(["a", "b"]);
    residency.arrived("b", 10, 1);
    residency.ready(1, ["a", "b"], bitsOf("ab"), [], 900, 20);
    work();
    expect(residency.swap()).toMatchObject({ degraded: false, shown: ["b"], hidden: [] });
  });

  it("shows the whole at once where ready comes before the swap", () => {
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "ab"));
    residency.arrived("a", 10, 1);
    residency.degraded(1, ["a"], bitsOf("a"));
    work();
    residency.arrived("b", 10, 1);
    residency.ready(1, ["a", "b"], bitsOf("ab"), [], 900, 20);
    expect(residency.presentable()).toBeNull();
    work();
    expect(residency.presentable()).toBe("full");
  });
});

describe("a segment that cannot be decoded", () => {
  it("keeps the landing waiting until the stream has another plan: no hole is shown", () => {
    land(1, "ab");
    work("b");
    expect(residency.presentable()).toBeNull();
    answerTo(residency, 1, "", "a");
    work();
    expect(residency.swap()?.visible).toEqual(["a"]);
  });

  it("is tried again when it comes again", () => {
    land(1, "a");
    work("a");
    residency.arrived("a", 10, 1);
    expect(work()).toBe("a");
    expect(residency.swap()?.visible).toEqual(["a"]);
  });
});

describe("the same landing again", () => {
  beforeEach(() => {
    show(1, "ab", "", HERE);
    show(2, "c", "b", THERE);
    residency.land(3, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
  });

  it("is shown before the service has answered, and the answer changes nothing", () => {
    expect(residency.swap()).toMatchObject({ landing: 3, shown: ["a"], hidden: ["c"] });
    expect(residency.newest).toMatchObject({ readyMs: null, plan: { landing: 3, loadBytes: 0 } });
    answerTo(residency, 3, "", "ab");
    work();
    expect(residency.presentable()).toBeNull();
    expect(residency.newest).toMatchObject({ readyMs: 5, swapped: "full" });
    expect(text(residency.visible)).toBe("ab");
  });

  it("may be shown in the middle of the answer", () => {
    residency.planned(plan(3, "", "ab"));
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBe("full");
    residency.ready(3, ["a", "b"], bitsOf("ab"), [], 5, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.swap()).toMatchObject({ shown: ["a"], hidden: ["c"] });
  });

  it("goes by the answer where that says otherwise, and so the next time", () => {
    residency.swap();
    answerTo(residency, 3, "d", "b");
    work();
    expect(residency.swap()).toMatchObject({ shown: ["d"], hidden: ["a"] });
    show(4, "", "bc", THERE);
    residency.land(5, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(text(residency.swap()?.visible)).toBe("bd");
  });

  it("waits where the answer takes it back before it was shown", () => {
    residency.planned(plan(3, "d", "b"));
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it.each([
    ["with another radius", HERE, 59, {}],
    ["a centimetre away", [1.01, 2, 3], 60, {}],
    ["with a ring", HERE, 60, { coarseRadiusM: 180 }],
  ] as const)("is another one: %s", (_, at, radiusM, options) => {
    residency.land(4, at, radiusM, 0, options);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it.each(["sessionOpened", "versionChanged", "contextLost"] as const)("is asked again after %s", (forget) => {
    residency[forget]();
    residency.land(4, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });

  it("is forgotten after 32 others", () => {
    for (let other = 0; other < 31; other += 1) show(10 + other, "", "b", [other, 99, 0]);
    residency.land(50, THERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBe("full");
    residency.land(51, HERE, 60, 0);
    residency.basePrepared(residency.comingRevision);
    expect(residency.presentable()).toBeNull();
  });
});

describe("bounds", () => {
  it("decodes so many at a time, in the plan's order", () => {
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "fedcba"));
    for (const key of "abcdef") residency.arrived(key, 10, 1);
    expect(residency.takeDecodes().map(({ segment }) => segment)).toEqual(["f", "e", "d", "c"]);
    residency.decoded("e", 0, BYTES);
    expect(residency.takeDecodes()).toEqual([]); // It waits for its upload.
    residency.uploaded("e");
    expect(residency.takeDecodes()).toEqual([{ segment: "b", epoch: 0 }]);
  });

  it("keeps what an aim brought within the spare bytes, and what is wanted whatever it takes", () => {
    for (const key of "abcde") residency.arrived(key, 10, null);
    work();
    expect(residency.spareBytes).toBe(3 * BYTES);
    land(1, "", "abcde");
    expect(work()).toBe("de");
    expect(residency.spareBytes).toBe(0);
    expect(text(residency.swap()?.visible)).toBe("abcde");
  });

  it("frees what was left behind for what aims bring, and no aim for another", () => {
    show(1, "ab");
    show(2, "c");
    for (const key of "def") residency.arrived(key, 10, null);
    expect(work()).toBe("def");
    residency.arrived("g", 10, null);
    expect(work()).toBe("");
    expect(residency.takeFreed()).toEqual(["a", "b"]);
    // After the next swap they are left behind like everything else.
    show(3, "h");
    expect(residency.takeFreed()).toEqual(["d"]);
  });

  it("puts a landing before any prefetch", () => {
    residency.arrived("p", 10, null);
    residency.land(1, HERE, 60, 0);
    residency.planned(plan(1, "a"));
    residency.arrived("a", 10, 1);
    expect(residency.takeDecodes().map(({ segment }) => segment)).toEqual(["a", "p"]);
  });
});

describe("a reconnect", () => {
  it("that declares the same set again asks for no swap", () => {
    show(1, "a");
    answerTo(residency, 1, "", "a");
    expect(work()).toBe("");
    expect(residency.presentable()).toBeNull();
    expect(residency.newest?.swapped).toBe("full");
  });

  it("to a new version forgets all, drops answers of the old, and shows nothing until the new base is here", () => {
    show(1, "ab");
    residency.land(2, HERE, 60, 0);
    residency.planned(plan(2, "c"));
    residency.arrived("c", 10, 2);
    const [request] = residency.takeDecodes();
    residency.versionChanged();
    expect(text(residency.visible)).toBe("ab");
    expect(residency.decoded("c", request!.epoch, BYTES)).toBe(false);
    answerTo(residency, 2, "", "a");
    expect(residency.takeDecodes()).toEqual([{ segment: "a", epoch: 1 }]);
    residency.clearVisible();
    expect(residency.visible).toEqual([]);
    residency.decoded("a", 1, BYTES);
    work();
    expect(residency.swap()?.visible).toEqual(["a"]);
  });
});

describe("a lost context", () => {
  it("uploads the visible set again before anything else, and shows it when all of it is back", () => {
    show(1, "ab");
    residency.land(2, HERE, 60, 0);
    residency.planned(plan(2, "c"));
    residency.arrived("c", 10, 2);
    residency.contextLost();
    expect(text(residency.visible)).toBe("ab");
    expect(residency.restorable()).toBeNull();
    expect(work()).toBe("abc");
    expect(residency.restorable()).toEqual(bitsOf("ab"));
    residency.restored();
    expect(residency.restoring).toBe(false);
    expect(text(residency.visible)).toBe("ab");
  });

  it("draws the base alone where a segment cannot be decoded again: no hole may stay there", () => {
    show(1, "ab");
    residency.contextLost();
    work("b");
    expect(residency.restoring).toBe(false);
    expect(residency.visible).toEqual([]);
    answerTo(residency, 1, "", "a");
    work();
    expect(residency.swap()?.visible).toEqual(["a"]);
  });
});

describe("whatever happens", () => {
  it.each(Array.from({ length: 40 }, (_, seed) => seed))("the visible set changes in swap alone (seed %i)", (seed) => {
    const next = random(seed);
    const choose = (count: number): number => Math.floor(next() * count);
    const keys = (): string => [..."abcdefghijklmnopqrstuvwx"].filter(() => next() < 0.3).join("");
    const gpu = new Set<string>(); // What a stage would hold.
    const held = new Set<string>();
    const decoding: { segment: string; epoch: number }[] = [];
    let [landing, swaps] = [0, 0];
    let asked: PlanFacts | null = null;
    const free = (): void => {
      for (const key of residency.takeFreed()) gpu.delete(key);
    };
    for (let step = 0; step < 1000; step += 1) {
      const before = residency.visible;
      const act = choose(12);
      if (act === 0 && (landing === 0 || next() < 0.2)) {
        landing += 1;
        asked = null;
        residency.land(landing, HERE, 60, step);
      } else if (act === 1 && landing > 0 && (asked === null || next() < 0.1)) {
        const target = [...keys()];
        const here = target.filter((key) => held.has(key)).join("");
        asked = plan(landing, target.filter((key) => !held.has(key)).join(""), here);
        residency.planned(asked);
      } else if (act === 2 && asked) {
        for (const { key, follows } of asked.show) {
          held.add(key);
          if (follows) residency.arrived(key, 10, landing);
        }
        residency.ready(
          landing,
          asked.show.map(({ key }) => key),
          asked.hidden,
          [],
          1,
          1,
        );
      } else if (act === 3 && asked?.show[0]) {
        const { key } = asked.show[0];
        held.add(key);
        residency.arrived(key, 10, landing);
        residency.degraded(landing, [key], bitsOf(key));
      } else if (act === 4) {
        const key = "abcdefghijklmnopqrstuvwx"[choose(24)]!;
        held.add(key);
        residency.arrived(key, 10, null);
      } else if (act === 5 && landing > 0 && next() < 0.2) residency.refused(landing, "no");
      else if (act === 6 && next() < 0.1) {
        residency.contextLost();
        gpu.clear();
      } else if (act < 10) {
        decoding.push(...residency.takeDecodes());
        expect(residency.inFlight).toBeLessThanOrEqual(4);
        const answer = decoding.splice(choose(Math.max(decoding.length, 1)), 1)[0];
        // A failure while the visible set is restored is a test of its own.
        if (answer && next() < 0.03 && !residency.restoring) residency.decodeFailed(answer.segment, answer.epoch);
        else if (answer) residency.decoded(answer.segment, answer.epoch, BYTES);
        const upload = residency.nextUpload();
        free();
        if (upload !== null && residency.nextUpload() === upload) {
          residency.uploaded(upload);
          residency.warmed(upload);
          gpu.add(upload);
        }
      } else {
        residency.basePrepared(residency.comingRevision);
        if (residency.restorable() !== null) {
          expect(residency.visible.every((key) => gpu.has(key))).toBe(true);
          residency.restored();
        }
        const kind = residency.presentable();
        const swap = residency.swap();
        expect(swap !== null).toBe(kind !== null);
        if (swap) {
          swaps += 1;
          expect(residency.visible).toEqual(swap.visible);
          expect(swap.visible.every((key) => gpu.has(key))).toBe(true);
          expect(swap.shown).toEqual(swap.visible.filter((key) => !before.includes(key)));
          expect(swap.hidden).toEqual(before.filter((key) => !swap.visible.includes(key)));
          free();
          continue;
        }
      }
      free();
      expect(residency.visible).toBe(before);
      expect(residency.spareBytes).toBeLessThanOrEqual(3 * BYTES);
    }
    expect(swaps).toBeGreaterThan(0);
  });
});
