import { describe, expect, it } from "vitest";

import { CoverCounters } from "../src/core/cover.ts";
import { random } from "./random.ts";

function cover(rows: readonly (readonly number[])[]) {
  const offsets = new Uint32Array(rows.length + 1);
  rows.forEach((row, face) => {
    offsets[face + 1] = offsets[face]! + row.length;
  });
  return { offsets, segments: Uint32Array.from(rows.flat()) };
}

function hiddenByTheRule(rows: readonly (readonly number[])[], shown: ReadonlySet<number>): number[] {
  return rows.map((row) => (row.length > 0 && row.every((segment) => shown.has(segment)) ? 1 : 0));
}

describe("CoverCounters", () => {
  it("hides a face if and only if its list is not empty and all of it is shown", () => {
    const counters = new CoverCounters(cover([[0], [0, 1], []]));
    expect([...counters.show([0])]).toEqual([0]);
    expect([...counters.hidden]).toEqual([1, 0, 0]);
    expect([...counters.show([0, 1])]).toEqual([1]);
    expect([...counters.hidden]).toEqual([1, 1, 0]);
    expect([...counters.show([1])]).toEqual([0, 1]);
    expect([...counters.hidden]).toEqual([0, 0, 0]);
    expect(counters.hiddenCount).toBe(0);
  });

  it("tells the rim: drawn faces over which some but not all segments are shown", () => {
    const counters = new CoverCounters(cover([[0], [0, 1], [1], []]));
    counters.show([0]);
    expect([0, 1, 2, 3].map((face) => counters.isRim(face))).toEqual([false, true, false, false]);
  });

  it("takes repeats, and segments that lie over no face, for what they are", () => {
    const counters = new CoverCounters(cover([[3]]));
    expect([...counters.add(3)]).toEqual([0]);
    expect([...counters.add(3)]).toEqual([]);
    expect([...counters.add(99)]).toEqual([]);
    expect([...counters.remove(7)]).toEqual([]);
    expect([...counters.shown]).toEqual([3, 99]);
    expect([...counters.remove(3)]).toEqual([0]);
  });

  it("reports a face that one segment leaves and another does not free as unchanged", () => {
    const counters = new CoverCounters(cover([[0], [1]]));
    counters.show([0]);
    expect([...counters.show([1])]).toEqual([0, 1]);
    const both = new CoverCounters(cover([[0, 1]]));
    both.show([0, 1]);
    expect([...both.show([1, 0])]).toEqual([]);
  });

  it("agrees with the rule after every step of a long random walk, and its hash with the set alone", () => {
    const next = random(7);
    const rows = Array.from({ length: 300 }, () =>
      [...new Set(Array.from({ length: Math.floor(next() * 5) }, () => Math.floor(next() * 40)))].sort((a, b) => a - b),
    );
    const counters = new CoverCounters(cover(rows));
    const hashes = new Map<string, number>();
    for (let step = 0; step < 400; step += 1) {
      const hiddenBefore = [...counters.hidden];
      const target = new Set(Array.from({ length: 40 }, (_, id) => id).filter(() => next() < (step % 10) / 10));
      const changed = counters.show(target);
      const expected = hiddenByTheRule(rows, target);
      expect([...counters.hidden]).toEqual(expected);
      expect([...changed]).toEqual(expected.flatMap((state, face) => (state === hiddenBefore[face] ? [] : [face])));
      expect(counters.hiddenCount).toBe(expected.filter((state) => state === 1).length);
      const fresh = new CoverCounters(cover(rows));
      fresh.show([...target].reverse());
      expect(counters.hiddenHash).toBe(fresh.hiddenHash);
      hashes.set(expected.join(""), counters.hiddenHash);
    }
    expect(new Set(hashes.values()).size).toBe(hashes.size);
  });

  it.each([
    [{ offsets: Uint32Array.of(1, 1), segments: Uint32Array.of(0) }, "cover offsets run 1..1, expected 0..1"],
    [{ offsets: Uint32Array.of(0, 2, 1, 2), segments: Uint32Array.of(0, 1) }, "cover offsets fall after face 1"],
    [{ offsets: Uint32Array.of(0, 2), segments: Uint32Array.of(4, 4) }, "cover names segments 4 and 4 of face 0"],
    [{ offsets: Uint32Array.of(0, 1), segments: Uint32Array.of(2 ** 31) }, "cover names segment 2147483648"],
  ])("refuses what is no list of ascending segments (%#)", (rows, message) => {
    expect(() => new CoverCounters(rows)).toThrow(message);
  });

  it.each([-1, 0.5, Number.NaN])("refuses the segment id %d", (id) => {
    const counters = new CoverCounters(cover([[0]]));
    expect(() => counters.add(id)).toThrow(`segment id ${id}`);
    expect(() => counters.show([0, id])).toThrow(`segment id ${id}`);
    expect([...counters.hidden]).toEqual([0]);
  });
});
