/** The small pure parts: cache, assembly, waits, pace. */

import { describe, expect, test } from "vitest";
import { budgetsFor } from "../../src/core/budgets.ts";
import { xxh3 } from "../../src/core/payload/hash.ts";
import { Assembler } from "../../src/core/session/assembly.ts";
import { waitMs } from "../../src/core/session/backoff.ts";
import { type CachedSegment, SegmentCache } from "../../src/core/session/cache.ts";
import { Pacer } from "../../src/core/session/pacing.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import { afterClose } from "../../src/core/wire/errors.ts";
import { random as seeded } from "../random.ts";

function entry(segment: number, size: number): CachedSegment {
  const facts = { segment, length: size, xxh3: 0n, faces: 1, vertices: 3, bounds: [0, 0, 0, 1, 1, 1] } as const;
  return { facts, payload: new Uint8Array(size) };
}

describe("the cache", () => {
  test("does over any history what a list does slowly", () => {
    for (let seed = 0; seed < 100; seed++) {
      const random = seeded(seed);
      const maxBytes = Math.floor(random() * 120);
      const cache = new SegmentCache(maxBytes);
      let model: [number, number][] = []; // id and size, least recently used first
      let pinned: number[] = [];
      for (let step = 0; step < 40; step++) {
        const action = Math.floor(random() * 5);
        const id = Math.floor(random() * 7);
        const matching = model.filter(([key]) => key === id);
        const remaining = model.filter(([key]) => key !== id);
        if (action === 0) {
          const size = 1 + Math.floor(random() * 50);
          cache.put(entry(id, size));
          model = [...remaining, [id, size]];
        } else if (action === 1) {
          expect(cache.get(id) !== undefined).toBe(matching.length > 0);
          model = [...remaining, ...matching];
        } else if (action === 2) {
          expect(cache.discard(id)).toBe(matching.length > 0);
          model = remaining;
        } else if (action === 3) {
          pinned = [id, (id + 1) % 7];
          cache.pin(pinned);
        } else {
          const evicted: number[] = [];
          for (const item of [...model]) {
            if (model.reduce((sum, [, size]) => sum + size, 0) <= maxBytes) break;
            if (pinned.includes(item[0])) continue;
            model = model.filter((candidate) => candidate !== item);
            evicted.push(item[0]);
          }
          expect(cache.trim().map((facts) => facts.segment)).toEqual(evicted);
        }
        expect(cache.ids()).toEqual(model.map(([key]) => key));
        expect(cache.bytes).toBe(model.reduce((sum, [, size]) => sum + size, 0));
      }
    }
  });

  test("does not change an age by a peek", () => {
    const cache = new SegmentCache(10);
    for (const segment of [1, 2]) cache.put(entry(segment, 5));
    expect(cache.peek(1)).toBeDefined();
    cache.put(entry(3, 5));
    expect(cache.trim().map((facts) => facts.segment)).toEqual([1]);
  });

  test("refuses a bound below 0", () => {
    expect(() => new SegmentCache(-1)).toThrow(/-1 bytes, expected 0 or more/);
    expect(() => new SegmentCache(Number.NaN)).toThrow(RangeError);
  });
});

describe("assembly", () => {
  const payload = Uint8Array.from({ length: 40 }, (_, at) => at);
  const chunk = (start: number, end: number, segment = 1) => ({
    segment,
    offset: start,
    total: payload.length,
    last: end === payload.length,
    chunk: payload.subarray(start, end),
  });

  test("gives the payload however it was cut", () => {
    for (let seed = 0; seed < 50; seed++) {
      const random = seeded(seed);
      const assembler = new Assembler();
      let payload: Uint8Array | null = null;
      for (let at = 0; at < 40; ) {
        expect(payload).toBeNull();
        expect(assembler.received(1)).toBe(at);
        const end = Math.min(40, at + 1 + Math.floor(random() * 20));
        payload = assembler.take(chunk(at, end), 40);
        at = end;
      }
      expect(payload).toEqual(payload);
      expect(assembler.size).toBe(0);
    }
  });

  test.each([
    [2, 4, 40, /continues at byte 2, expected 3/],
    [4, 5, 40, /continues at byte 4, expected 3/],
    [3, 5, 39, /announces 40 bytes, expected 39 by the plan/],
  ])("refuses a gap, an overlap and a wrong total", (start, end, length, text) => {
    const assembler = new Assembler();
    assembler.take(chunk(0, 3), 40);
    expect(() => assembler.take(chunk(start, end), length)).toThrow(text);
  });

  test("forgets the parts that a plan does not need", () => {
    const assembler = new Assembler();
    for (const segment of [1, 2, 3]) assembler.take(chunk(0, 3, segment), 40);
    assembler.keepOnly(new Set([2]));
    expect([1, 2, 3].map((segment) => assembler.received(segment))).toEqual([0, 3, 0]);
    assembler.clear();
    expect(assembler.size).toBe(0);
  });
});

describe("waits before connecting again", () => {
  test.each([0, 1, 3, 5, 6, 60, 1e6])("stay between half and all of the doubling: attempt %d", (attempt) => {
    const maxMs = Math.min(30_000, 500 * 2 ** Math.min(attempt, 30));
    const random = seeded(1);
    const waits = Array.from({ length: 200 }, () => waitMs(attempt, random()));
    expect(Math.min(...waits)).toBeGreaterThanOrEqual(maxMs / 2);
    expect(Math.max(...waits)).toBeLessThanOrEqual(maxMs);
    expect(Math.max(...waits) - Math.min(...waits)).toBeGreaterThan(0.3 * maxMs);
  });

  test("are made after exactly the close codes that the protocol lists (11)", () => {
    for (const code of [1001, 1006, 1011, 1012, 4408, 4429, 4500, 4503]) expect(afterClose(code)).toBe("again");
    for (const code of [4400, 4403, 4404, 4409, 4413]) expect(afterClose(code)).toBe("stop");
    expect([afterClose(1000), afterClose(4401)]).toEqual(["done", "token"]);
  });
});

test("the pace is one that the server's own bucket never finds too fast (12)", () => {
  for (let seed = 0; seed < 50; seed++) {
    const random = seeded(seed);
    const perS = 0.5 + random() * 200;
    let nowMs = 1000;
    const pacer = new Pacer(perS, nowMs);
    let tokens = Math.max(1, perS * 10);
    for (let message = 0; message < 300; message++) {
      const beforeMs = nowMs;
      nowMs += random() * 3000 * (seed % 2);
      nowMs += pacer.take(nowMs);
      tokens = Math.min(Math.max(1, perS * 10), tokens + ((nowMs - beforeMs) / 1000) * perS) - 1;
      expect(tokens).toBeGreaterThanOrEqual(-1e-6);
    }
  }
});

test("every bound of every device is a positive number, and less where there is little memory", () => {
  for (const device of ["desktop", "phone", "headset"] as const) {
    const budgets = budgetsFor(device);
    for (const value of Object.values(budgets)) expect(value).toBeGreaterThan(0);
    expect(budgets.maxSegments).toBeLessThanOrEqual(16_384);
    expect(budgetsFor(device, 1).maxGpuBytes).toBe(128 * 1024 * 1024);
    expect(budgetsFor(device, 64)).toEqual(budgets);
  }
});

test("options that the protocol does not allow are refused at once", () => {
  const options = { client: "t", budgets: {}, creditBytes: 1 } as const;
  expect(() => new ClientSession({ ...options, creditBytes: 0 }, 1, xxh3)).toThrow(RangeError);
  expect(() => new ClientSession({ ...options, budgets: { maxBytes: -1 } }, 1, xxh3)).toThrow(RangeError);
  expect(() => new ClientSession(options, -1, xxh3)).toThrow(RangeError);
});
