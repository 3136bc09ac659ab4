/** What is evicted, rejected, offered and dropped: the client's state machine against the model server. */

import { describe, expect, test } from "vitest";
import { ClientSession } from "../../src/core/session/session.ts";
import { decodeMessage } from "../../src/core/wire/codec.ts";
import { encodeFrame } from "../../src/core/wire/frames.ts";
import { ModelServer } from "./model-server.ts";
import { flipped, Pair, segmentOf } from "./pairing.ts";
import { MIDDLE, ToyScene, toyHash } from "./toy-scene.ts";

const toy = new ToyScene();

function messagesOf(client: ClientSession) {
  return client.dataToSend().map((data) => decodeMessage(data, "client_to_server"));
}

describe("evictions", () => {
  test("are told before the next landing, and as events at once", () => {
    const pair = new Pair(toy, { cacheBytes: 0 }).connect();
    for (const position of [
      [0, 0, 0],
      [10, 0, 10],
      [0, 0, 0],
    ] as const) {
      pair.client.land(position, 2);
      pair.settle();
    }
    const plans = pair.of("planned").map((event) => event.plan);
    expect(plans[2]?.load_bytes).toBe(plans[0]?.load_bytes);
    expect(plans[2]?.load_bytes).toBeGreaterThan(0);
    const away = toy.within([10, 0, 10], 2);
    expect(pair.of("dropped").at(-1)?.segments).toEqual(expect.arrayContaining(away));
    const beyond = [...pair.server!.held.keys()].filter((segment) => !pair.client.visible.includes(segment));
    pair.client.land([0, 0, 0], 2);
    const messages = messagesOf(pair.client);
    expect(messages.map((message) => message.type)).toEqual(["evict", "land"]);
    expect(messages[0]).toEqual({ type: "evict", segments: beyond.sort((a, b) => a - b) });
  });

  test("never come between a landing and its plan (6.7, rule 2)", () => {
    const pair = new Pair(toy, { cacheBytes: 0 }).connect();
    pair.client.land([0, 0, 0], 2);
    pair.settle();
    pair.client.land([10, 0, 10], 2);
    pair.settle();
    pair.client.land([0, 0, 0], 2);
    for (const data of pair.client.dataToSend()) pair.server?.receive(data);
    pair.client.land([10, 0, 10], 2);
    const data = pair.client.dataToSend();
    expect(data.length).toBe(1);
    pair.server?.receive(data[0]!);
    expect(pair.server?.heard.at(-1)?.type).toBe("land");
    pair.settle();
    expect(pair.client.visible).toEqual(toy.within([10, 0, 10], 2));
  });

  test("wait where a landing becomes ready while a newer one has no plan: that may keep what went out of sight", () => {
    const pair = new Pair(toy, { cacheBytes: 0 }).connect();
    pair.client.land([0, 0, 0], 2);
    pair.settle();
    pair.client.land([10, 0, 10], 2);
    const total = pair.received.length + toy.within([10, 0, 10], 2).length;
    while (pair.received.length < total) pair.step();
    pair.client.land([0, 0, 0], 2);
    const onTheirWay = pair.client.dataToSend();
    pair.client.receive(pair.server!.next()!);
    expect(pair.client.visible).toEqual(toy.within([10, 0, 10], 2));
    for (const data of onTheirWay) pair.server!.receive(data);
    pair.settle();
    expect(pair.of("rejected")).toEqual([]);
    expect(pair.of("planned").at(-1)?.plan.load_bytes).toBe(0);
    expect(pair.client.visible).toEqual(toy.within([0, 0, 0], 2));
  });

  test("are not told to a new connection: what it is not offered, it does not count on", () => {
    const pair = new Pair(toy, { cacheBytes: 0 }).connect();
    for (const position of [
      [0, 0, 0],
      [10, 0, 10],
    ] as const) {
      pair.client.land(position, 2);
      pair.settle();
    }
    expect(pair.of("dropped").length).toBe(1);
    pair.disconnect();
    pair.connect().settle();
    pair.client.land([0, 0, 0], 2);
    pair.settle();
    expect(pair.server?.heard.map((message) => message.type)).toEqual(["hello", "land"]);
  });

  test("spare what a degraded landing shows until it is ready", () => {
    const pair = new Pair(toy, { cacheBytes: 0 }).connect();
    pair.settle();
    pair.client.land([0, 0, 0], 5, { innerRadiusM: 1, deadlineMs: 1 });
    while (pair.received.length < 3) pair.step();
    pair.server!.deadlinePassed = true;
    while (pair.of("degraded").length === 0) pair.step();
    pair.client.land([10, 0, 10], 0.5);
    while (pair.of("planned").length < 2) pair.step();
    const inner = toy.within([0, 0, 0], 1);
    expect(inner.every((segment) => pair.client.holdings.has(segment))).toBe(true);
    pair.settle();
    expect(inner.some((segment) => pair.client.holdings.has(segment))).toBe(false);
  });
});

describe("a wrong byte", () => {
  test("is rejected, and the segment sent again", () => {
    const pair = new Pair(toy).connect();
    let spoilt = 0;
    pair.spoil = (data) => (segmentOf(data) === 14 && spoilt++ === 0 ? flipped(data) : data);
    pair.client.land(MIDDLE, 4);
    pair.settle();
    const [rejected] = pair.of("rejected");
    expect(rejected).toMatchObject({ segment: 14, expected: toy.facts[14]?.xxh3 });
    expect(rejected?.actual).not.toBe(rejected?.expected);
    expect(pair.of("ready").at(-1)?.missing).toEqual([]);
    expect(pair.client.holdings.peek(14)?.payload).toEqual(toy.payloads[14]);
  });

  test("twice leaves the segment missing; the next landing tries again", () => {
    const pair = new Pair(toy).connect();
    pair.spoil = (data) => (segmentOf(data) === 14 ? flipped(data) : data);
    pair.client.land(MIDDLE, 4);
    pair.settle();
    const expected = toy.within(MIDDLE, 4);
    expect(pair.of("rejected").length).toBe(2);
    expect(pair.of("ready")).toMatchObject([{ missing: [14], visible: expected.filter((id) => id !== 14) }]);
    expect(pair.client.holdings.has(14)).toBe(false);
    pair.spoil = null;
    pair.client.land(MIDDLE, 4);
    pair.settle();
    expect(pair.client.visible).toEqual(expected);
  });

  test("whose reject crosses the next landing is sent again in that one, and rejected once (6.4, rule 7)", () => {
    const pair = new Pair(toy, { lag: 5 }).connect();
    let frames = 0;
    pair.spoil = (data) => (frames++ === 0 ? flipped(data) : data);
    pair.client.land([0, 0, 0], 1);
    while (frames === 0) pair.step();
    pair.client.land([0, 0, 0], 1);
    pair.settle();
    expect(pair.of("rejected").length).toBe(1);
    expect(pair.of("planned").at(-1)?.plan.keep).toEqual([0]);
    expect(pair.of("ready").at(-1)?.missing).toEqual([]);
    expect(pair.client.holdings.peek(0)?.payload).toEqual(toy.payloads[0]);
  });
});

describe("an offer", () => {
  test("names what is held in hello, newest first, or nothing where the server found that too large", () => {
    const pair = new Pair(toy).connect();
    pair.client.land(MIDDLE, 4);
    pair.settle();
    pair.disconnect();
    pair.client.connected();
    const [hello] = messagesOf(pair.client);
    expect(hello).toMatchObject({ type: "hello", encoding: "glb", protocol: [1, 0] });
    const rows = hello?.type === "hello" ? hello.held : undefined;
    const expected = pair.client.visible.map((segment) => ({ segment, xxh3: toy.facts[segment]?.xxh3 }));
    expect([...(rows ?? [])].sort((a, b) => a.segment - b.segment)).toEqual(expected);
    pair.client.connected(false);
    expect(messagesOf(pair.client)).toMatchObject([{ type: "hello", held: [] }]);
  });

  test("goes in as many tables as the server asks for, before the landing", () => {
    const pair = new Pair(toy, { maxHeldSegments: 5 }).connect();
    pair.client.land(MIDDLE, 5);
    pair.settle();
    pair.disconnect();
    pair.offerHeld = false;
    pair.client.land(MIDDLE, 5);
    pair.connect().settle();
    const count = toy.within(MIDDLE, 5).length;
    const types = pair.server?.heard.map((message) => message.type);
    expect(types).toEqual(["hello", ...Array(Math.ceil(count / 5)).fill("held"), "land"]);
    expect(pair.of("planned").at(-1)?.plan.load_bytes).toBe(0);
    expect(pair.client.repeatedBytes).toBe(0);
  });

  test("is not made to a server that takes no table; what it does not know of is not held", () => {
    const pair = new Pair(toy, { maxHeldSegments: 0 }).connect();
    pair.client.land(MIDDLE, 4);
    pair.settle();
    pair.disconnect();
    pair.offerHeld = false;
    pair.connect().settle();
    expect(pair.server?.heard.map((message) => message.type)).toEqual(["hello"]);
    expect(pair.of("dropped").at(-1)?.segments.length).toBe(toy.within(MIDDLE, 4).length);
    expect(pair.client.holdings.count).toBe(0);
    pair.client.land(MIDDLE, 4);
    pair.settle();
    expect(pair.client.visible).toEqual(toy.within(MIDDLE, 4));
    expect(pair.client.repeatedBytes).toBe(0);
  });
});

test("a newer version hides all, drops what changed and keeps the rest (5, rules 3 and 4)", () => {
  const pair = new Pair(toy).connect();
  pair.client.land(MIDDLE, 4);
  pair.settle();
  const visibleBefore = pair.client.visible;
  pair.disconnect();
  const newer = new ToyScene({ version: "v2" });
  const changed = visibleBefore.slice(0, 3);
  for (const segment of changed) newer.replace(segment, new Uint8Array(300).fill(segment));
  pair.scene = newer;
  pair.received = [];
  pair.connect().settle();
  expect(pair.of("opened").map((event) => event.changed)).toEqual([false, true]);
  expect(pair.of("dropped").map((event) => [...event.segments].sort((a, b) => a - b))).toEqual([changed]);
  expect(pair.client.visible).toEqual([]);
  pair.client.land(MIDDLE, 4);
  pair.settle();
  expect([...pair.received].sort((a, b) => a - b)).toEqual(changed);
  expect(pair.client.visible).toEqual(visibleBefore);
});

describe("picks", () => {
  test("are answered, and asked again after a lost connection, unless dropped", () => {
    const pair = new Pair(toy).connect();
    const first = pair.client.pick([0, 1, 0]);
    pair.disconnect();
    const second = pair.client.pick([0, 1, 0], [0, -1, 0]);
    pair.client.dropPick(pair.client.pick([5, 1, 0]));
    pair.connect().settle();
    expect(pair.of("pick-answered").map((event) => event.request)).toEqual([first, second]);
    expect(pair.of("pick-answered")[0]?.hit).toMatchObject({ segment: 3, heightM: 9, stableId: null, label: null });
    expect(pair.client.awaitsAnswer).toBe(false);
  });

  test("that are refused are told", () => {
    const pair = new Pair(toy, { maxPicks: 0 }).connect();
    const request = pair.client.pick([0, 0, 0]);
    pair.settle();
    expect(pair.of("pick-refused")).toMatchObject([{ request, code: "too_many" }]);
    expect(pair.of("refused")).toEqual([]);
  });
});

test("news are passed on; groups, and what is not known, are skipped", () => {
  const pair = new Pair(toy).connect();
  pair.settle();
  pair.server?.say({ type: "notice", kind: "scene_published", version: "v9" });
  pair.server?.say({ type: "notice", kind: "draining", reconnect_after_ms: 1000 });
  pair.server?.say({ type: "roster", group: "g", members: [] });
  pair.settle();
  pair.client.receive(Uint8Array.of(0x81, 0xa4, 0x74, 0x79, 0x70, 0x65, 0xa3, 0x6e, 0x65, 0x77)); // {"type": "new"}
  pair.client.receive(Uint8Array.of(0x05, 1, 2, 3)); // a frame of a later kind
  expect(pair.of("notice").map((event) => [event.kind, event.version, event.reconnectAfterMs])).toEqual([
    ["scene_published", "v9", null],
    ["draining", null, 1000],
  ]);
});

describe("a number that cannot be", () => {
  test.each<[string, (client: ClientSession) => unknown]>([
    ["radius_m", (client) => client.land([0, 0, 0], 0)],
    ["radius_m", (client) => client.land([0, 0, 0], -1)],
    ["radius_m", (client) => client.land([0, 0, 0], Number.NaN)],
    ["position", (client) => client.land([Number.POSITIVE_INFINITY, 0, 0], 1)],
    ["inner_radius_m", (client) => client.land([0, 0, 0], 1, { deadlineMs: 5 })],
    ["inner_radius_m", (client) => client.land([0, 0, 0], 1, { innerRadiusM: 2 })],
    ["radius_m", (client) => client.aim([0, 0, 0], 0)],
    ["direction", (client) => client.pick([0, 0, 0], [0, 0, 0])],
  ])("is refused here: %s, %s", (_field, call) => {
    const pair = new Pair(toy).connect();
    pair.settle();
    expect(() => call(pair.client)).toThrow(RangeError);
    expect(pair.client.dataToSend()).toEqual([]);
    expect(pair.client.awaitsAnswer).toBe(false);
    expect(pair.client.land(MIDDLE, 1)).toBe(1);
  });

  test("in the options is refused here", () => {
    const options = { client: "t", budgets: {}, creditBytes: 1 } as const;
    expect(() => new ClientSession({ ...options, creditBytes: 0 }, 1, toyHash)).toThrow(RangeError);
    expect(() => new ClientSession({ ...options, budgets: { maxBytes: -1 } }, 1, toyHash)).toThrow(RangeError);
    expect(() => new ClientSession(options, -1, toyHash)).toThrow(RangeError);
  });
});

describe("what the protocol forbids is a violation", () => {
  const frame = (generation: number, segment: number, offset: number, total: number) =>
    encodeFrame({ generation, segment, offset, total, chunk: new Uint8Array(1) });

  test.each<[RegExp, (pair: Pair) => void]>([
    [/got 0 bytes/, (pair) => pair.client.receive(new Uint8Array(0))],
    [/msgpack|0xc1/i, (pair) => pair.client.receive(Uint8Array.of(0xc1))],
    [/text/, (pair) => pair.client.receive("{}")],
    [/generation 5/, (pair) => pair.client.receive(frame(5, 1, 0, 4))],
    [/does not load/, (pair) => pair.client.receive(frame(1, 35, 0, 4))],
    [/announces/, (pair) => pair.client.receive(frame(1, 0, 0, toy.payloads[0]!.length + 1))],
    [/continues at byte 1, expected 0/, (pair) => pair.client.receive(frame(1, 0, 1, toy.payloads[0]!.length))],
    [/second welcome/, (pair) => pair.client.receive(welcome())],
  ])("%s", (text, give) => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.client.land([0, 0, 0], 1);
    while (pair.of("planned").length === 0) pair.step();
    expect(() => give(pair)).toThrow(text);
  });

  test("a plan before the welcome", () => {
    const model = new ModelServer(toy);
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.client.land(MIDDLE, 1);
    for (const data of pair.client.dataToSend()) pair.server?.receive(data);
    const plan = pair.server?.next();
    const otherPair = new Pair(toy);
    otherPair.client.connected();
    expect(() => otherPair.client.receive(plan!)).toThrow(/plan first/);
    expect(() => pair.client.receive(model.next() ?? plan!)).not.toThrow();
    expect(() => pair.client.receive(plan!)).toThrow(/plan of generation 1, expected none/);
  });

  test("a plan that keeps what was never held", () => {
    const pair = new Pair(toy).connect();
    pair.settle();
    pair.server?.held.set(7, toy.facts[7]!.xxh3);
    pair.client.land([2, 0, 2], 1);
    expect(() => pair.settle()).toThrow(/keeps segment 7, which was never held/);
  });

  function welcome(): Uint8Array<ArrayBuffer> {
    const model = new ModelServer(toy);
    const client = new Pair(toy).client;
    client.connected();
    for (const data of client.dataToSend()) model.receive(data);
    return model.next() as Uint8Array<ArrayBuffer>;
  }
});
