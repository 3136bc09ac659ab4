/** Frame times, and the store. */

import { describe, expect, test, vi } from "vitest";
import { createFrameTimes, KEPT_FRAMES, summariseFrames } from "../src/app/frame-times.ts";
import { createStore } from "../src/app/store.ts";

describe("frame times", () => {
  test("leave rests out", () => {
    const times = createFrameTimes();
    times.begin(1000, true);
    times.begin(1016, false);
    times.begin(1033, false);
    times.begin(9000, true);
    times.begin(9020, false);
    expect(times.recent).toEqual([16, 17, 20]);
  });

  test("are bounded", () => {
    const times = createFrameTimes();
    for (let index = 0; index <= KEPT_FRAMES + 50; index += 1) times.begin(index * 10, index === 0);
    expect(times.recent).toHaveLength(KEPT_FRAMES);
  });

  test("are summed up", () => {
    expect(summariseFrames([])).toBeNull();
    const hundred = Array.from({ length: 100 }, (_, index) => 100 - index);
    expect(summariseFrames(hundred)).toEqual({ count: 100, medianMs: 51, p95Ms: 96, maxMs: 100 });
    expect(hundred[0]).toBe(100);
  });
});

describe("a store", () => {
  test("tells of changes, with what was before, and of nothing else", () => {
    const store = createStore({ a: 1, b: "x" });
    const listener = vi.fn();
    const stop = store.subscribe(listener);
    store.set({ a: 1 });
    expect(listener).not.toHaveBeenCalled();
    const previousState = store.get();
    store.set({ a: 2 });
    expect(listener).toHaveBeenCalledExactlyOnceWith({ a: 2, b: "x" }, previousState);
    expect(previousState).toEqual({ a: 1, b: "x" });
    stop();
    store.set({ a: 3 });
    expect(listener).toHaveBeenCalledTimes(1);
  });
});
