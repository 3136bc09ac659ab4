/** What is kept for the next visit: it comes back as it was, or not at all. */

import { beforeAll, expect, test } from "vitest";
import { prepareHash, xxh3 } from "../../src/core/payload/hash.ts";
import type { CachedSegment } from "../../src/core/session/cache.ts";
import { readBundle, writeBundle } from "../../src/core/session/kept-bundle.ts";
import { mutated, seeded } from "../seeded.ts";

function entry(segment: number, bytes: number): CachedSegment {
  const payload = Uint8Array.from({ length: bytes }, (_, at) => (segment + 7 * at) % 251);
  const facts = { segment, length: bytes, xxh3: xxh3(payload), faces: 9, vertices: 8, bounds: [0, 1, 2, 3, 4, 5.5] };
  return { facts, payload } as unknown as CachedSegment;
}

beforeAll(prepareHash);

test("comes back as it was written", () => {
  const entries = [entry(3, 100), entry(700, 1), entry(0, 4096)];
  expect(readBundle(writeBundle(entries), xxh3)).toEqual(entries);
  expect(readBundle(writeBundle([]), xxh3)).toEqual([]);
});

test("a changed payload alone is left out", () => {
  const entries = [entry(3, 100), entry(4, 100), entry(5, 100)];
  const bundle = writeBundle(entries);
  bundle[bundle.length - 150]! ^= 1;
  expect(readBundle(bundle, xxh3).map(({ facts }) => facts.segment)).toEqual([3, 5]);
  expect(readBundle(bundle.slice(0, -1), xxh3).map(({ facts }) => facts.segment)).toEqual([3]);
});

test("any damage brings whole payloads or none", () => {
  const chance = seeded(11);
  const bundle = writeBundle([entry(3, 60), entry(4, 60)]);
  for (let round = 0; round < 500; round += 1) {
    for (const { facts, payload } of readBundle(mutated(bundle, chance), xxh3)) {
      expect(xxh3(payload)).toBe(facts.xxh3);
    }
  }
});
