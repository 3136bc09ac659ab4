/** Random landings, aims, cuts and flipped bits: the last landing alone decides what is visible. */

import { describe, expect, test } from "vitest";
import type { Vec3 } from "../../src/core/types.ts";
import { flipped, Pair } from "./pairing.ts";
import { MIDDLE, seeded, ToyScene } from "./toy-scene.ts";

const SEEDS = 100;

describe("whatever happens", () => {
  const toy = new ToyScene();
  test.each([false, true])(
    "the visible set is that of the last landing (bits flipped: %s)",
    (spoils) => {
      for (let seed = 0; seed < SEEDS; seed++) oneHistory(toy, seed, spoils);
    },
    60_000,
  );
});

function oneHistory(toy: ToyScene, seed: number, spoils: boolean): void {
  const random = seeded(seed);
  const pick = <T>(values: readonly T[]): T => values[Math.floor(random() * values.length)]!;
  const randomPosition = (): Vec3 => [random() * 16 - 2, 0, random() * 16 - 2];
  const radiusM = () => 0.5 + random() * 7.5;
  const cacheBytes = pick([0, 2000, 8000, 1 << 20]);
  const pair = new Pair(toy, {
    cacheBytes,
    creditBytes: pick([50, 700, 1 << 20]),
    lag: pick([0, 1, 5, 30]),
    maxChunk: pick([7, 100, 100_000]),
    releaseFactor: pick([1, 1.5]),
    maxHeldSegments: pick([1, 5, 1000]),
    random,
  }).connect();
  pair.offerHeld = random() < 0.5;
  let spoilNext = false;
  pair.spoil = (data) => {
    const spoilt = spoilNext ? flipped(data) : data;
    spoilNext = false;
    return spoilt;
  };
  const label = `seed ${seed}`;
  const steps = Math.floor(random() * 25);
  for (let step = 0; step < steps; step++) {
    const action = pick(["land", "aim", "run", "run", "cut", "spoil"] as const);
    if (action === "land") pair.client.land(randomPosition(), radiusM());
    else if (action === "aim") {
      pair.client.aim(randomPosition(), radiusM());
      pair.client.flushAim();
    } else if (action === "cut") {
      pair.disconnect();
      pair.connect();
    } else if (action === "spoil") spoilNext = spoils;
    else for (let count = Math.floor(random() * 60); count > 0; count--) pair.step();
  }
  spoilNext = false;
  pair.client.land(MIDDLE, 3.3);
  pair.settle();
  const visible = pair.client.visible;
  const plan = pair.of("planned").at(-1)!.plan;
  const planned = [...plan.load.map((facts) => facts.segment), ...plan.keep].sort((a, b) => a - b);
  expect(visible, label).toEqual(planned);
  expect(visible, label).toEqual(toy.within(MIDDLE, 3.3));
  expect(pair.client.unfinished, label).toBeNull();
  expect(pair.client.partialCount, label).toBe(0);
  expect(pair.client.repeatedBytes, label).toBe(0);
  if (!spoils) expect(pair.of("rejected"), label).toEqual([]);
  const pinned = [...visible, ...plan.nearby];
  expect(pair.client.holdings.cacheBytes, label).toBeLessThanOrEqual(Math.max(cacheBytes, toy.bytesOf(pinned)));
  for (const segment of pinned) {
    expect(pair.client.holdings.peek(segment)?.payload, label).toEqual(toy.payloads[segment]);
  }
  // What was told as here and not as gone is here, and nothing else.
  const reported = new Set<number>();
  for (const event of pair.events) {
    if (event.type === "arrived") reported.add(event.entry.facts.segment);
    else if (event.type === "dropped") for (const segment of event.segments) reported.delete(segment);
  }
  expect(
    [...reported].filter((segment) => !pair.client.holdings.has(segment)),
    label,
  ).toEqual([]);
  expect(reported.size, label).toBe(pair.client.holdings.count);
  // Every landing ends in one way: ready, superseded, or the last one.
  const ends = [...pair.of("ready"), ...pair.of("superseded")].map((event) => event.landing);
  expect(new Set(ends).size, label).toBe(ends.length);
  // What the server believes held is here, once the next landing has told the evictions.
  pair.client.land(MIDDLE, 3.3);
  pair.settle();
  const believed = [...pair.server!.held.keys()].filter((segment) => !pair.client.holdings.has(segment));
  expect(believed, label).toEqual([]);
}
