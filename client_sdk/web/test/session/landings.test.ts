/** Landings, supersede, resume and aims: the client's state machine against the model server. */

import { describe, expect, test } from "vitest";
import { flipped, Pair } from "./pairing.ts";
import { MIDDLE, ToyScene } from "./toy-scene.ts";

const toy = new ToyScene();

describe("a landing", () => {
  test("shows exactly what brute force finds", () => {
    const pair = new Pair(toy).connect();
    const number = pair.client.land(MIDDLE, 4);
    pair.settle();
    const expected = toy.within(MIDDLE, 4);
    const bytes = toy.bytesOf(expected);
    expect(pair.of("ready")).toEqual([
      { type: "ready", landing: number, visible: expected, missing: [], payloadBytes: bytes, timings: null },
    ]);
    expect(pair.client.visible).toEqual(expected);
    expect(pair.server?.chunkBytes).toBe(bytes);
    expect(pair.client.payloadBytes).toBe(bytes);
    for (const segment of expected) {
      expect(pair.client.holdings.peek(segment)?.payload).toEqual(toy.payloads[segment]);
      expect(pair.client.holdings.peek(segment)?.facts).toEqual(toy.facts[segment]);
    }
  });

  test("costs no bytes the second time", () => {
    const pair = new Pair(toy).connect();
    for (let visit = 0; visit < 2; visit++) {
      pair.client.land(MIDDLE, 4);
      pair.settle();
    }
    const [first, second] = pair.of("planned").map((event) => event.plan);
    expect(second?.load_bytes).toBe(0);
    expect(second?.keep.length).toBe(first?.load.length);
    expect(pair.of("ready")[1]?.payloadBytes).toBe(0);
    expect(new Set(pair.received).size).toBe(pair.received.length);
  });

  test("keeps what lies a little beyond its radius, and does not show it (6.6)", () => {
    const pair = new Pair(toy, { cacheBytes: 0, releaseFactor: 1.5 }).connect();
    for (const radiusM of [6, 4.5, 6]) {
      pair.client.land(MIDDLE, radiusM);
      pair.settle();
      expect(pair.client.visible).toEqual(toy.within(MIDDLE, radiusM));
    }
    const [first, second, third] = pair.of("planned").map((event) => event.plan);
    expect(second?.nearby).toEqual(toy.within(MIDDLE, 6).filter((id) => !toy.within(MIDDLE, 4.5).includes(id)));
    expect(second?.nearby.length).toBeGreaterThan(0);
    expect(third?.load).toEqual([]);
    expect(third?.keep.length).toBe(first?.load.length);
    expect(pair.of("dropped")).toEqual([]);
    pair.client.land(MIDDLE, 1);
    pair.settle();
    const dropped = pair.of("dropped").flatMap((event) => event.segments);
    expect(dropped).not.toEqual([]);
    expect(dropped.filter((id) => toy.within(MIDDLE, 1.5).includes(id))).toEqual([]);
  });

  test("is not ready before the server says so, though it is whole (6.4, rule 5)", () => {
    const pair = new Pair(toy).connect();
    pair.client.land(MIDDLE, 4);
    const count = toy.within(MIDDLE, 4).length;
    while (pair.received.length < count) pair.step();
    expect(pair.of("ready")).toEqual([]);
    expect(pair.client.visible).toEqual([]);
    pair.settle();
    expect(pair.of("ready").length).toBe(1);
  });

  test("comes whole however small the credit", () => {
    const pair = new Pair(toy, { creditBytes: 1 }).connect();
    pair.client.land([0, 0, 0], 0.5);
    pair.settle();
    expect(pair.client.visible).toEqual([0]);
  });

  test("is granted credit in steps of half, not for every chunk", () => {
    const pair = new Pair(toy, { creditBytes: 4000, maxChunk: 100 }).connect();
    pair.client.land(MIDDLE, 9);
    pair.settle();
    const grants = pair.server?.heard.filter((message) => message.type === "credit") ?? [];
    const total = toy.bytesOf(toy.within(MIDDLE, 9));
    expect(grants.length).toBe(Math.floor(total / 2000));
    for (const grant of grants) expect(grant.bytes).toBeLessThan(2100);
  });

  test("keeps to the budgets, and says what they left out", () => {
    const pair = new Pair(toy, { budgets: { maxSegments: 3 } }).connect();
    pair.client.land(MIDDLE, 4);
    pair.settle();
    const plan = pair.of("planned")[0]?.plan;
    expect(pair.client.visible.length).toBe(3);
    expect(plan?.omitted_by).toBe("max_segments");
    expect(plan?.omitted_segments).toBe(toy.within(MIDDLE, 4).length - 3);
  });

  test("declares the inner set after its deadline, as soon as that is whole here, and goes on", () => {
    const pair = new Pair(toy, { creditBytes: 2000 }).connect();
    pair.settle();
    pair.client.land(MIDDLE, 5, { innerRadiusM: 1.5, deadlineMs: 100 });
    const inner = toy.within(MIDDLE, 1.5);
    while (pair.received.length < inner.length) pair.step();
    pair.server!.deadlinePassed = true;
    pair.settle();
    expect(pair.of("degraded").map((event) => event.segments)).toEqual([inner]);
    expect(pair.client.visible).toEqual(toy.within(MIDDLE, 5));
  });

  test("is not declared degraded with a segment that came wrong", () => {
    const pair = new Pair(toy, { lag: 30 }).connect();
    pair.settle();
    let spoilt = 0;
    pair.spoil = (data) => (spoilt++ === 0 ? flipped(data) : data);
    pair.client.land(MIDDLE, 5, { innerRadiusM: 1.5, deadlineMs: 100 });
    pair.step();
    pair.server!.deadlinePassed = true;
    pair.settle();
    const at = pair.events.findIndex((event) => event.type === "degraded");
    const inner = toy.within(MIDDLE, 1.5);
    const arrivedBefore = pair.events
      .slice(0, at)
      .flatMap((e) => (e.type === "arrived" ? [e.entry.facts.segment] : []));
    expect(arrivedBefore).toEqual(expect.arrayContaining(inner));
    expect(pair.of("rejected").map((event) => inner.includes(event.segment))).toEqual([true]);
  });

  test("without what the server cannot read is ready, and tries it again the next time (6.4, rule 6)", () => {
    const pair = new Pair(toy).connect();
    pair.server!.unreadable.add(14);
    pair.client.land(MIDDLE, 4);
    pair.settle();
    const expected = toy.within(MIDDLE, 4);
    expect(pair.of("ready")[0]?.missing).toEqual([14]);
    expect(pair.client.visible).toEqual(expected.filter((segment) => segment !== 14));
    pair.server!.unreadable.clear();
    pair.client.land(MIDDLE, 4);
    pair.settle();
    expect(pair.client.visible).toEqual(expected);
  });
});

describe("a newer landing", () => {
  test("supersedes, and what is half here goes on", () => {
    const scene = new ToyScene({ mostBytes: 5000 });
    const pair = new Pair(scene, { creditBytes: 100 }).connect();
    const first = pair.client.land([0, 0, 0], 1);
    while ((pair.server?.chunkBytes ?? 0) < 300) pair.step();
    const second = pair.client.land([0, 0, 0], 2);
    pair.settle();
    expect(pair.of("superseded")).toEqual([{ type: "superseded", landing: first, by: second }]);
    expect(pair.of("ready").map((event) => event.landing)).toEqual([second]);
    expect(pair.server?.chunkBytes).toBe(scene.bytesOf(scene.within([0, 0, 0], 2)));
  });

  test("ends one that has no plan yet, and never gets one (6.3)", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    const server = pair.server;
    if (server == null) throw new Error("not connected");
    server.plansLate = true;
    const [first, second] = [1, 2].map((radius) => {
      const landing = pair.client.land(MIDDLE, radius);
      for (const data of pair.client.dataToSend()) server.receive(data);
      return landing;
    });
    server.planLate();
    pair.settle();
    expect(pair.of("superseded")).toEqual([{ type: "superseded", landing: first, by: second }]);
    expect(pair.of("planned").map((event) => event.landing)).toEqual([second]);
    expect(pair.of("ready").map((event) => event.landing)).toEqual([second]);
    expect(pair.client.visible).toEqual(toy.within(MIDDLE, 2));
  });

  test("somewhere else makes the parts of the older one forgotten", () => {
    const pair = new Pair(new ToyScene({ mostBytes: 5000 }), { creditBytes: 100 }).connect();
    pair.client.land([0, 0, 0], 1);
    while ((pair.server?.chunkBytes ?? 0) < 300) pair.step();
    expect(pair.client.partialCount).toBe(1);
    pair.client.land([10, 0, 10], 0.5);
    const planned = pair.of("planned").length;
    while (pair.of("planned").length === planned) pair.step();
    expect(pair.client.partialCount).toBe(0);
  });

  test("that is refused leaves the older one going (6.5, rule 5)", () => {
    const pair = new Pair(toy).connect();
    const accepted = pair.client.land(MIDDLE, 4);
    for (let step = 0; step < 3; step++) pair.step();
    const bad = pair.client.land(MIDDLE, 501);
    pair.settle();
    expect(pair.of("refused")).toMatchObject([{ landing: bad, code: "radius_too_large", fatal: false }]);
    expect(pair.of("ready").map((event) => event.landing)).toEqual([accepted]);
    expect(pair.of("superseded")).toEqual([]);
  });

  test("before the connection is the only one that waits for it", () => {
    const pair = new Pair(toy);
    const first = pair.client.land([0, 0, 0], 1);
    const second = pair.client.land(MIDDLE, 1);
    pair.connect().settle();
    expect(pair.of("superseded")).toEqual([{ type: "superseded", landing: first, by: second }]);
    expect(pair.of("ready").map((event) => event.landing)).toEqual([second]);
  });

  test("takes the place of one that never left: one `land` waits to be sent at most", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    for (let count = 0; count < 100; count++) pair.client.land(MIDDLE, 1 + count / 50);
    pair.client.pick([0, 0, 0]);
    const messages = pair.client.dataToSend();
    expect(messages.length).toBe(2);
    for (const data of messages) pair.server?.receive(data);
    pair.settle();
    expect(pair.of("superseded").length).toBe(99);
    expect(pair.of("ready").map((event) => event.landing)).toEqual([100]);
    expect(pair.client.visible).toEqual(toy.within(MIDDLE, 1 + 99 / 50));
  });
});

describe("a lost connection", () => {
  test.each([0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 33])(
    "after %d steps is resumed, and no segment comes twice",
    (steps) => {
      const pair = new Pair(toy, { creditBytes: 300 }).connect();
      const number = pair.client.land(MIDDLE, 4);
      for (let step = 0; step < steps; step++) pair.step();
      pair.disconnect();
      expect(pair.client.unfinished === number || pair.of("ready").length === 1).toBe(true);
      expect(pair.client.partialCount).toBe(0);
      pair.connect().settle();
      const expected = toy.within(MIDDLE, 4);
      expect(pair.of("ready").at(-1)).toMatchObject({ landing: number, visible: expected, missing: [] });
      expect([...pair.received].sort((a, b) => a - b)).toEqual(expected);
      expect(pair.client.repeatedBytes).toBe(0);
    },
  );

  test("makes what the old one said of ready void", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    let frames = 0;
    pair.spoil = (data) => (frames++ === 0 ? flipped(data) : data);
    const number = pair.client.land([0, 0, 0], 0.5);
    while (frames === 0) pair.step();
    // The reject of it waits in the outbox while the server says ready.
    pair.client.receive(pair.server!.next()!);
    expect(pair.of("rejected").length).toBe(1);
    expect(pair.of("ready")).toEqual([]);
    pair.disconnect();
    pair.connect();
    while (pair.received.length === 0) pair.step();
    expect(pair.of("ready")).toEqual([]);
    pair.settle();
    expect(pair.of("ready").map((event) => event.landing)).toEqual([number]);
  });

  test("leaves what is shown until the new landing is ready (10.3)", () => {
    const pair = new Pair(toy).connect();
    pair.client.land([0, 0, 0], 2);
    pair.settle();
    const visibleBefore = pair.client.visible;
    pair.client.land(MIDDLE, 4);
    pair.step();
    pair.disconnect();
    pair.connect();
    expect(pair.client.visible).toEqual(visibleBefore);
    pair.settle();
    expect(pair.client.visible).toEqual(toy.within(MIDDLE, 4));
  });
});

describe("an aim", () => {
  test("is held for the landing that follows, which costs nothing", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.client.aim(MIDDLE, 3);
    expect(pair.client.hasAim).toBe(true);
    pair.client.flushAim();
    pair.settle();
    const expected = toy.within(MIDDLE, 3);
    expect(pair.of("prefetching")).toMatchObject([{ segments: expected.length, bytes: toy.bytesOf(expected) }]);
    expect(pair.of("prefetched")).toMatchObject([{ segments: expected.length }]);
    expect(pair.client.visible).toEqual([]);
    pair.client.land(MIDDLE, 3);
    pair.settle();
    expect(pair.of("planned").at(-1)?.plan.load_bytes).toBe(0);
    expect(pair.client.visible).toEqual(expected);
    const { landings, hits, usedBytes, prefetchedBytes } = pair.client.aims;
    expect([landings, hits, usedBytes, prefetchedBytes]).toEqual([1, 1, toy.bytesOf(expected), toy.bytesOf(expected)]);
  });

  test("that was elsewhere is a miss, and counted", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.client.aim([0, 0, 0], 1);
    pair.client.flushAim();
    pair.settle();
    pair.client.land(MIDDLE, 2);
    pair.settle();
    const { landings, hits, usedBytes, prefetchedBytes } = pair.client.aims;
    expect([landings, hits, usedBytes]).toEqual([1, 0, 0]);
    expect(prefetchedBytes).toBe(toy.bytesOf(toy.within([0, 0, 0], 1)));
  });

  test("replaces the one before, and is dropped by a landing", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    for (let x = 0; x < 5; x++) pair.client.aim([x, 0, 0], 1);
    pair.client.flushAim();
    expect(pair.client.dataToSend().length).toBe(1);
    pair.client.aim([0, 0, 0], 1);
    pair.client.land(MIDDLE, 1);
    expect(pair.client.hasAim).toBe(false);
  });

  test("that comes wrong twice is given up", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.spoil = flipped;
    pair.client.aim([0, 0, 0], 0.5);
    pair.client.flushAim();
    pair.settle();
    expect(pair.of("rejected").map((event) => event.segment)).toEqual([0, 0]);
    expect(pair.of("prefetched").length).toBe(1);
    expect(pair.client.holdings.has(0)).toBe(false);
  });

  test("that a cut ended is sent anew, and nothing comes twice (7, rule 4)", () => {
    const pair = new Pair(toy, { creditBytes: 300 }).connect();
    pair.settle();
    pair.client.aim(MIDDLE, 3);
    pair.client.flushAim();
    while (pair.received.length < 2) pair.step();
    pair.disconnect();
    pair.connect().settle(true);
    expect([...pair.received].sort((a, b) => a - b)).toEqual(toy.within(MIDDLE, 3));
    expect(pair.of("prefetched").length).toBe(1);
    pair.client.land(MIDDLE, 3);
    pair.settle();
    expect(pair.of("planned").at(-1)?.plan.load_bytes).toBe(0);
  });

  test("is not sent anew once all has come, or the user has landed", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.client.aim(MIDDLE, 3);
    pair.client.flushAim();
    pair.settle();
    pair.disconnect();
    pair.connect().settle();
    expect(pair.client.hasAim).toBe(false);
    pair.client.aim([0, 0, 0], 3);
    pair.client.flushAim();
    pair.client.land(MIDDLE, 3);
    pair.disconnect();
    pair.connect().settle();
    expect(pair.client.hasAim).toBe(false);
    expect(pair.of("ready").at(-1)?.visible).toEqual(toy.within(MIDDLE, 3));
  });

  test("after an unfinished landing comes behind it again", () => {
    const pair = new Pair(toy, { creditBytes: 300 }).connect();
    pair.settle();
    const number = pair.client.land(MIDDLE, 3);
    pair.client.aim([0, 0, 0], 2);
    pair.client.flushAim();
    while (pair.received.length === 0) pair.step();
    pair.disconnect();
    pair.connect().settle(true);
    const kinds = pair.events.filter((event) => event.type === "ready" || event.type === "prefetched");
    expect(kinds.map((event) => event.type)).toEqual(["ready", "prefetched"]);
    expect(kinds[0]).toMatchObject({ landing: number });
    expect(new Set(pair.received).size).toBe(pair.received.length);
  });
});
