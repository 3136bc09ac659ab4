/** Payloads on disk: what comes back on the next visit, and what of a damaged disk. */

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { DiskCache } from "../../src/core/client/disk-cache.ts";
import type { CachedSegment } from "../../src/core/session/cache.ts";
import { mutated, seeded } from "../seeded.ts";

const SCENE = "http://server.test/scenes/quarry";

let stored: Map<string, Uint8Array<ArrayBuffer>>;

beforeEach(() => {
  vi.useFakeTimers();
  stored = new Map();
  const storage = {
    keys: async () => [...stored.keys()].map((url) => ({ url })),
    match: async ({ url }: { url: string }) => new Response(stored.get(url)),
    put: async (url: string, response: Response) => stored.set(url, new Uint8Array(await response.arrayBuffer())),
    delete: async ({ url }: { url: string }) => stored.delete(url),
  };
  vi.stubGlobal("caches", { open: async () => storage });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

function entry(number: number, bytes: number): CachedSegment {
  const payload = Uint8Array.from({ length: bytes }, (_, at) => (number + 7 * at) % 251);
  return { key: number.toString(16).padStart(16, "0"), payload, bounds: [0, 1, 2, 3, 4, 5.5] };
}

async function written(entries: readonly CachedSegment[], maxBytes = 1e6): Promise<void> {
  const disk = new DiskCache(SCENE, maxBytes);
  for (const one of entries) disk.put(one);
  await vi.advanceTimersByTimeAsync(2000);
}

const restored = (maxBytes = 1e6) => new DiskCache(SCENE, 1e6).restore(maxBytes);

test("what was written comes back, the newest last, within the bound", async () => {
  const [first, second] = [[entry(3, 100), entry(700, 1)], [entry(0, 4096)]];
  await written(first);
  await written(second);
  expect(await restored()).toEqual([...first].reverse().concat(second));
  expect(await restored(4300)).toEqual(second);
  expect(await new DiskCache(`${SCENE}-other`, 1e6).restore(1e6)).toEqual([]);
});

test("the oldest goes where the bound is exceeded", async () => {
  await written([entry(1, 3000)], 5000);
  await written([entry(2, 3000)], 5000);
  expect((await restored()).map(({ key }) => key)).toEqual([entry(2, 1).key]);
});

test("any damage brings segments under their own keys, or none", async () => {
  const entries = [entry(3, 60), entry(4, 60)];
  await written(entries);
  const [[url, bundle]] = stored as unknown as [[string, Uint8Array<ArrayBuffer>]];
  const chance = seeded(11);
  for (let round = 0; round < 500; round += 1) {
    stored.set(url!, mutated(bundle!, chance));
    for (const { key, payload } of await restored()) {
      const original = entries.find((one) => one.key === key);
      expect(payload.length).toBe(original?.payload.length);
    }
  }
  stored.set(url!, bundle!.slice(0, -1));
  expect(await restored()).toEqual([entries[0]]);
});

test("a disk that cannot be used keeps nothing, and is no error", async () => {
  vi.stubGlobal("caches", { open: () => Promise.reject(new DOMException("full", "QuotaExceededError")) });
  await written([entry(1, 10)]);
  expect(await restored()).toEqual([]);
});
