/** Which decode worker gets what, and what becomes of a job whose worker fails. */

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { DecodePool } from "../../src/core/client/decode-pool.ts";
import { sentError } from "../../src/core/client/worker-errors.ts";
import type { DecodeAnswer, DecodeJob } from "../../src/core/client/worker-messages.ts";
import { PayloadError } from "../../src/core/payload/errors.ts";
import type { MeshData } from "../../src/core/types.ts";

/** A worker whose answers the test gives. */
class StandInWorker {
  onmessage: ((event: { data: DecodeAnswer }) => void) | null = null;
  onerror: ((event: { message: string; preventDefault: () => void }) => void) | null = null;
  onmessageerror: ((event: object) => void) | null = null;
  readonly jobs: DecodeJob[] = [];
  ended = false;

  postMessage(job: DecodeJob): void {
    this.jobs.push(job);
  }

  terminate(): void {
    this.ended = true;
  }

  answer(): void {
    const mesh = { faceCount: this.jobs.at(-1)?.payload[0] } as unknown as MeshData;
    this.onmessage?.({ data: { type: "decoded", mesh } });
  }

  crash(): void {
    this.onerror?.({ message: "out of memory", preventDefault: () => {} });
  }
}

let workers: StandInWorker[];
let pool: DecodePool;
/** Its mesh has as many faces as the number says. */
const job = (number: number): DecodeJob => ({ payload: Uint8Array.of(number), attributes: [] });

beforeEach(() => {
  vi.useFakeTimers();
  workers = [];
  pool = new DecodePool(2, () => {
    const worker = new StandInWorker();
    workers.push(worker);
    return worker as unknown as Worker;
  });
});

afterEach(() => {
  pool.close();
  vi.useRealTimers();
});

test("no more workers than allowed, one job each, in order", async () => {
  const meshes = [4, 5, 6, 7].map((segment) => pool.decode(job(segment)));
  expect(workers.map((worker) => worker.jobs.map((job) => job.payload[0]))).toEqual([[4], [5]]);
  for (const worker of [1, 0, 1, 0]) workers[worker]!.answer();
  expect((await Promise.all(meshes)).map((mesh) => mesh.faceCount)).toEqual([4, 5, 6, 7]);
  expect(workers.map((worker) => worker.jobs.map((job) => job.payload[0]))).toEqual([
    [4, 7],
    [5, 6],
  ]);
});

test("a payload is copied for the worker: the cache keeps its own", () => {
  const view = new Uint8Array(64).subarray(24, 27);
  pool.decode({ payload: view, attributes: [] }).catch(() => {});
  const sent = workers[0]!.jobs[0]!.payload;
  expect([sent.byteLength, sent.buffer.byteLength, sent.buffer === view.buffer]).toEqual([3, 3, false]);
});

test("a worker that fails is told to its job alone, and replaced", async () => {
  const first = pool.decode(job(1));
  const second = pool.decode(job(2));
  const third = pool.decode(job(3));
  workers[0]!.crash();
  await expect(first).rejects.toMatchObject({ code: "worker_failed", message: expect.stringContaining("memory") });
  expect([workers.length, workers[0]!.ended, workers[2]!.jobs[0]?.payload[0]]).toEqual([3, true, 3]);
  workers[1]!.answer();
  workers[2]!.answer();
  expect([(await second).faceCount, (await third).faceCount]).toEqual([2, 3]);
});

test("a worker that is stuck is ended", async () => {
  const mesh = pool.decode(job(1));
  vi.advanceTimersByTime(30_000);
  await expect(mesh).rejects.toMatchObject({ code: "worker_failed" });
  expect(workers[0]!.ended).toBe(true);
});

test("five failures in a row and no more is tried", async () => {
  const meshes = Array.from({ length: 8 }, (_, segment) => pool.decode(job(segment)));
  for (let count = 0; count < 5; count++) workers.at(-1)!.crash();
  const ends = await Promise.allSettled([...meshes.slice(1)]);
  expect(ends.every((end) => end.status === "rejected")).toBe(true);
  await expect(pool.decode(job(9))).rejects.toMatchObject({ code: "no_decoder" });
  await expect(Promise.race([meshes[0], Promise.resolve("waits")])).resolves.toBe("waits");
  meshes[0]!.catch(() => {});
});

test("a payload that is damaged is no failure of the worker", async () => {
  for (let count = 0; count < 6; count++) {
    const mesh = pool.decode(job(1));
    const error = sentError(new PayloadError("got 3 bytes, expected a GLB", 0));
    workers[0]!.onmessage?.({ data: { type: "failed", error } });
    await expect(mesh).rejects.toMatchObject({ name: "StreamError", code: "damaged" });
  }
  expect(workers.length).toBe(1);
});

test("what waits is bounded, and told when the pool is closed", async () => {
  const meshes = Array.from({ length: 1026 }, (_, segment) => pool.decode(job(segment)));
  for (const mesh of meshes) mesh.catch(() => {});
  await expect(pool.decode(job(0))).rejects.toMatchObject({
    code: "too_many",
  });
  pool.close();
  const ends = await Promise.allSettled(meshes);
  expect(ends.every((end) => end.status === "rejected" && end.reason.code === "closed")).toBe(true);
  expect(workers.every((worker) => worker.ended)).toBe(true);
});
