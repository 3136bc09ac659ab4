/** What a stream may be opened with. */

import { expect, test } from "vitest";
import { openDirectStream } from "../../src/core/client/direct-stream.ts";
import { sessionOptionsOf } from "../../src/core/client/stream-options.ts";
import { StreamError } from "../../src/core/scene/errors.ts";
import type { StreamOptions } from "../../src/core/types.ts";

const sceneUrl = "http://127.0.0.1:8080/scenes/sample";

test("a scene's URL is enough: the rest is as for a desktop computer", () => {
  const { budgets, cacheBytes, creditBytes } = sessionOptionsOf({ sceneUrl });
  expect(budgets.maxTriangles).toBeGreaterThan(1_000_000);
  expect(budgets.maxSegments).toBeGreaterThan(100);
  expect(cacheBytes).toBeGreaterThan(1e8);
  expect(creditBytes).toBeGreaterThan(1e6);
});

test("what is given is taken, and nothing is added to it", () => {
  const given = { sceneUrl, budgets: { maxTriangles: 7 }, cacheBytes: 0, creditBytes: 70_000 };
  expect(sessionOptionsOf(given)).toMatchObject({ budgets: { maxTriangles: 7 }, cacheBytes: 0, creditBytes: 70_000 });
  expect(sessionOptionsOf({ sceneUrl, budgets: {} }).budgets).toEqual({});
});

test("what cannot be is refused where the stream is opened, by its name", () => {
  for (const [wrong, name] of [
    [{ budgets: { maxTriangles: -1 } }, /max_triangles/],
    [{ budgets: { maxSegments: "many" } }, /max_segments/],
    [{ budgets: { maxBytes: Number.NaN } }, /max_bytes/],
    [{ cacheBytes: Number.NaN }, /cacheBytes/],
    [{ creditBytes: 0 }, /credit/],
  ] as const) {
    const options = { sceneUrl, ...wrong } as unknown as StreamOptions;
    expect(() => openDirectStream(options, { WebSocket: class {} as never })).toThrow(name);
  }
});

test("an error is written as JSON with what it says", () => {
  const error = new StreamError("forbidden", "not yours", 403);
  expect(JSON.parse(JSON.stringify(error))).toEqual({
    name: "StreamError",
    code: "forbidden",
    message: "not yours",
    status: 403,
  });
});
