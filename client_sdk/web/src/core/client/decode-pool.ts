/** A few workers that decode payloads, one payload at a time each. */

import { StreamError } from "../scene/errors.ts";
import type { MeshData } from "../types.ts";
import { receivedError, workerFailure } from "./worker-errors.ts";
import type { DecodeAnswer, DecodeJob } from "./worker-messages.ts";

/** Jobs that wait; whoever asks for more has lost count. */
const MAX_WAITING = 1024;

/** A payload of 64 MiB on a slow phone takes seconds; longer, and the worker is stuck. */
const STUCK_MS = 30_000;

/** Workers that failed one after the other, without one mesh between: the next would, too. */
const MAX_FAILURES = 5;

interface Waiting extends DecodeJob {
  readonly resolve: (mesh: MeshData) => void;
  readonly reject: (error: StreamError) => void;
}

interface Busy {
  readonly worker: Worker;
  readonly job: Waiting;
  readonly timer: ReturnType<typeof setTimeout>;
}

/** Decode workers; made when they are first needed, replaced when they fail. */
export class DecodePool {
  readonly #size: number;
  readonly #make: () => Worker;
  readonly #idle: Worker[] = [];
  readonly #busy = new Map<Worker, Busy>();
  #waiting: Waiting[] = [];
  #failures = 0;

  /** `make` starts one worker that takes {@link DecodeJob}s. */
  constructor(size: number, make: () => Worker) {
    this.#size = size;
    this.#make = make;
  }

  /** Decode one payload, of which a copy is sent to a worker. Rejects with StreamError. */
  decode(job: DecodeJob): Promise<MeshData> {
    if (this.#waiting.length >= MAX_WAITING) {
      return Promise.reject(new StreamError("too_many", `${MAX_WAITING} segments wait for a decoder already`));
    }
    if (this.#failures >= MAX_FAILURES) {
      return Promise.reject(new StreamError("no_decoder", `the last ${MAX_FAILURES} decode workers failed`));
    }
    return new Promise((resolve, reject) => {
      this.#waiting.push({ ...job, resolve, reject });
      this.#proceed();
    });
  }

  /** End all workers; whoever waits is told. */
  close(): void {
    const error = new StreamError("closed", "the stream was closed here");
    for (const worker of this.#idle.splice(0)) worker.terminate();
    for (const { worker } of [...this.#busy.values()]) this.#take(worker)?.reject(error);
    this.#rejectWaiting(error);
  }

  #proceed(): void {
    while (this.#waiting.length > 0 && this.#failures < MAX_FAILURES) {
      const worker = this.#idle.pop() ?? this.#startWorker();
      if (worker === null) return;
      const job = this.#waiting.shift();
      if (job === undefined) return;
      const timer = setTimeout(
        () => this.#fail(worker, new StreamError("worker_failed", `no mesh in ${STUCK_MS / 1000} s`)),
        STUCK_MS,
      );
      this.#busy.set(worker, { worker, job, timer });
      // A copy: what is transferred is gone here, and the cache keeps its payload.
      const payload = job.payload.slice();
      const message: DecodeJob = { payload, attributes: job.attributes };
      worker.postMessage(message, [payload.buffer]);
    }
  }

  /** One more worker, if there may be one. */
  #startWorker(): Worker | null {
    // Asked only where none is idle: the busy ones are all that there are.
    if (this.#busy.size >= this.#size) return null;
    const worker = this.#make();
    worker.onmessage = (event: MessageEvent<DecodeAnswer>) => this.#answered(worker, event.data);
    worker.onerror = (event) => {
      event.preventDefault();
      this.#fail(worker, workerFailure("a decode worker", event));
    };
    worker.onmessageerror = (event) => this.#fail(worker, workerFailure("a decode worker", event));
    return worker;
  }

  #answered(worker: Worker, answer: DecodeAnswer): void {
    const busy = this.#busy.get(worker);
    if (busy === undefined) return;
    clearTimeout(busy.timer);
    this.#busy.delete(worker);
    this.#idle.push(worker);
    // Also by a payload that is damaged: the worker lives, and said so.
    this.#failures = 0;
    if (answer.type === "decoded") busy.job.resolve(answer.mesh);
    else busy.job.reject(receivedError(answer.error));
    this.#proceed();
  }

  #fail(worker: Worker, error: StreamError): void {
    this.#failures += 1;
    const at = this.#idle.indexOf(worker);
    if (at >= 0) this.#idle.splice(at, 1);
    worker.terminate();
    this.#take(worker)?.reject(error);
    if (this.#failures >= MAX_FAILURES) this.#rejectWaiting(error);
    this.#proceed();
  }

  /** Part from a busy worker; returns its job. */
  #take(worker: Worker): Waiting | undefined {
    const busy = this.#busy.get(worker);
    if (busy === undefined) return undefined;
    clearTimeout(busy.timer);
    this.#busy.delete(worker);
    worker.terminate();
    return busy.job;
  }

  #rejectWaiting(error: StreamError): void {
    const waiting = this.#waiting;
    this.#waiting = [];
    for (const job of waiting) job.reject(error);
  }
}
