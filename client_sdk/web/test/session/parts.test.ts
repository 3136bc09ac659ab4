/** The small pure parts: cache, waits, pace. */

import { describe, expect, test } from "vitest";
import { budgetsFor } from "../../src/core/budgets.ts";
import { waitMs } from "../../src/core/session/backoff.ts";
import { type CachedSegment, SegmentCache } from "../../src/core/session/cache.ts";
import { Pacer } from "../../src/core/session/pacing.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import { afterClose } from "../../src/core/wire/errors.ts";
import { random as seeded } from "../random.ts";

function entry(key: string, size: number): CachedSegment {
  return { key, payload: new Uint8Array(size), bounds: null };
}

describe("the cache", () => {
  const keys = (cache: SegmentCache) => Array.from(cache.entries(), ({ key }) => key);

  test("evicts the least recently used that nothing needs", () => {
    const cache = new SegmentCache(10);
    for (const key of ["a", "b", "c", "d"]) cache.put(entry(key, 5));
    cache.get("a");
    cache.peek("b");
    cache.trim(() => new Set(["b"]));
    expect(keys(cache)).toEqual(["b", "a"]);
    expect(cache.bytes).toBe(10);
    cache.put(entry("e", 5));
    cache.trim(() => new Set(["a", "b", "e"]));
    expect(cache.bytes).toBe(15); // What is needed may exceed the bound.
    cache.put(entry("e", 7));
    cache.delete("a");
    expect([cache.size, cache.bytes]).toEqual([2, 12]);
  });

  test("refuses a bound below 0", () => {
    expect(() => new SegmentCache(-1)).toThrow(/-1 bytes, expected 0 or more/);
    expect(() => new SegmentCache(Number.NaN)).toThrow(RangeError);
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
  expect(() => new ClientSession({ ...options, creditBytes: -1 }, 1)).toThrow(RangeError);
  expect(() => new ClientSession({ ...options, budgets: { maxBytes: -1 } }, 1)).toThrow(RangeError);
  expect(() => new ClientSession(options, -1)).toThrow(RangeError);
});
