/** A stream whose socket, session, cache and decoders are in workers: the page's side of it. */

import { checkGroup } from "../extras/group-state.ts";
import { StreamError } from "../scene/errors.ts";
import { streamUrl } from "../scene/urls.ts";
import { checkLand, checkPick } from "../session/session.ts";
import type {
  AttributeScale,
  LandOptions,
  MeshData,
  PickHit,
  SegmentKey,
  Stream,
  StreamEvent,
  StreamOptions,
  StreamStats,
  Vec3,
} from "../types.ts";
import { sharedNowMs } from "./clock.ts";
import { sessionOptionsOf } from "./stream-options.ts";
import { receivedError, sentError, workerFailure } from "./worker-errors.ts";
import type { StreamAnswer, StreamCommand, StreamMessage, StreamQuestion } from "./worker-messages.ts";

/** A worker that does not answer the goodbye is ended all the same. */
const CLOSE_MS = 1000;

/** Questions that wait for the worker; more are refused. */
const MAX_QUESTIONS = 2048;

interface Waiting {
  readonly resolve: (value: StreamAnswer) => void;
  readonly reject: (error: StreamError) => void;
}

type WithoutId<Q> = Q extends StreamQuestion ? Omit<Q, "id"> : never;

/**
 * Open a stream in a worker of its own. Returns at once; set `onEvent` in the same task.
 *
 * A worker that fails is told as the link state `closed` with code `worker_failed`, and everything that waits for it is
 * rejected; such a stream cannot be used any more, not even by `reconnect`: open another one.
 *
 * `land` and `aim` throw RangeError on numbers that the protocol does not allow; `pick` rejects with it.
 *
 * @throws StreamError `invalid_url`; RangeError on options that the protocol does not allow.
 */
export function openStream(options: StreamOptions): Stream {
  const page = new PageStream(options);
  const stream: Stream = {
    onEvent: () => {},
    land: (position, radiusM, landOptions) => page.land(position, radiusM, landOptions),
    aim: (position, radiusM, coarseRadiusM) => page.aim(position, radiusM, coarseRadiusM),
    pick: (origin, direction) => page.pick(origin, direction),
    mesh: (key, attributes) => page.mesh(key, attributes),
    stats: () => page.stats(),
    group: (command) => {
      checkGroup(command);
      page.send({ type: "group", command });
    },
    reconnect: (token) => page.send({ type: "reconnect", token }),
    close: () => page.close(),
  };
  page.emit = (event) => stream.onEvent(event);
  return stream;
}

class PageStream {
  emit: (event: StreamEvent) => void = () => {};
  readonly #worker: Worker;
  readonly #waiting = new Map<number, Waiting>();
  /** The page's function: it cannot be sent into a worker. */
  readonly #askToken: (() => string | Promise<string>) | null;
  #landings = 0;
  #questions = 0;
  /** Why the worker is of no use any more. */
  #ended: StreamError | null = null;

  constructor(options: StreamOptions) {
    // A worker's addresses are relative to its script, not to the page.
    const sceneUrl = new URL(options.sceneUrl, location.href).href;
    // Refuse it here, where the mistake is: the worker would report it as a closed connection.
    streamUrl(sceneUrl);
    sessionOptionsOf(options);
    this.#worker = new Worker(new URL("./stream.worker.ts", import.meta.url), {
      type: "module",
      name: "terraport stream",
    });
    this.#worker.onmessage = (event: MessageEvent<StreamMessage>) => this.#take(event.data);
    this.#worker.onerror = (event) => {
      event.preventDefault();
      this.#fail(workerFailure("the stream's worker", event));
    };
    this.#worker.onmessageerror = (event) => this.#fail(workerFailure("the stream's worker", event));
    const { token, ...others } = options;
    this.#askToken = typeof token === "function" ? token : null;
    this.send({
      type: "open",
      options: { ...others, sceneUrl, ...(typeof token === "string" ? { token } : {}) },
      asksForTokens: this.#askToken !== null,
      decoders: decodersFor(navigator.hardwareConcurrency),
    });
  }

  send(command: StreamCommand): void {
    if (this.#ended === null) this.#worker.postMessage(command);
  }

  land(position: Vec3, radiusM: number, options: LandOptions = {}): number {
    checkLand(position, radiusM, options);
    // Counted alike on both sides, so that the page has the number at once; the worker compares.
    this.#landings += 1;
    const number = this.#landings;
    this.send({ type: "land", number, position, radiusM, options, askedMs: sharedNowMs() });
    return number;
  }

  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    checkLand(position, radiusM, { coarseRadiusM });
    this.send({ type: "aim", position, radiusM, coarseRadiusM });
  }

  async pick(origin: Vec3, direction?: Vec3): Promise<PickHit | null> {
    checkPick(origin, direction);
    return (await this.#ask({ type: "pick", origin, direction })) as PickHit | null;
  }

  async mesh(key: SegmentKey, attributes: readonly AttributeScale[]): Promise<MeshData> {
    return (await this.#ask({ type: "mesh", key, attributes })) as MeshData;
  }

  async stats(): Promise<StreamStats> {
    return (await this.#ask({ type: "stats" })) as StreamStats;
  }

  close(): void {
    if (this.#ended !== null) return;
    // Before the end is noted: nothing is sent after it.
    this.send({ type: "close" });
    this.#end(new StreamError("closed", "the stream was closed here"));
    setTimeout(() => this.#worker.terminate(), CLOSE_MS);
  }

  // ---- private

  #ask(question: WithoutId<StreamQuestion>): Promise<StreamAnswer> {
    if (this.#ended !== null) return Promise.reject(this.#ended);
    if (this.#waiting.size >= MAX_QUESTIONS) {
      return Promise.reject(new StreamError("too_many", `${MAX_QUESTIONS} questions wait for an answer already`));
    }
    this.#questions += 1;
    const id = this.#questions;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject });
      this.send({ ...question, id });
    });
  }

  #take(message: StreamMessage): void {
    // Also after the end: it answers the goodbye.
    if (message.type === "closed") this.#worker.terminate();
    if (this.#ended !== null) return;
    if (message.type === "event") this.emit(message.event);
    else if (message.type === "answer") this.#answered(message.id)?.resolve(message.value);
    else if (message.type === "failed") this.#answered(message.id)?.reject(receivedError(message.error));
    else if (message.type === "token-wanted") void this.#giveToken(message.question);
    else if (message.type === "crashed") this.#fail(new StreamError("worker_failed", message.error.message));
  }

  async #giveToken(question: number): Promise<void> {
    try {
      const token = await this.#askToken?.();
      this.send({ type: "token", question, ...(token === undefined ? {} : { token }) });
    } catch (error) {
      this.send({ type: "token", question, error: sentError(error) });
    }
  }

  #answered(id: number): Waiting | undefined {
    const waiting = this.#waiting.get(id);
    this.#waiting.delete(id);
    return waiting;
  }

  #fail(error: StreamError): void {
    if (this.#ended !== null) return;
    this.#worker.terminate();
    this.#end(error);
    this.emit({ type: "link", link: { state: "closed", closeCode: 1006, code: error.code, message: error.message } });
  }

  #end(error: StreamError): void {
    this.#ended = error;
    for (const { reject } of this.#waiting.values()) reject(error);
    this.#waiting.clear();
  }
}

/** The page, the stream and the browser's own threads need cores, too: a third of them decodes. */
function decodersFor(cores: number | undefined): number {
  return Math.min(3, Math.max(1, Math.floor((cores ?? 4) / 3)));
}
