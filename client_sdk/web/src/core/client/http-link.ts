/**
 * A session without a connection: plans by HTTP, and payload by ranges of the pack, from the service, a CDN or object storage
 * (protocol, section 7).
 *
 * The session is given what a service would send. There are no picks and no groups.
 */

import { StreamError } from "../scene/errors.ts";
import { fetchBytes, fetchJson } from "../scene/http.ts";
import { checkManifest } from "../scene/manifest.ts";
import { waitMs } from "../session/backoff.ts";
import type { ClientMessage, PlanRow, ServerMessage } from "../wire/messages.ts";
import { decodeMessage } from "../wire/messages.ts";
import { Access } from "./access.ts";
import type { Connection, LinkOptions } from "./link.ts";
import { asStreamError } from "./worker-errors.ts";

/** Bytes between two payloads that are rather read than asked around. */
const MAX_GAP_BYTES = 64 * 1024;
const MAX_RANGE_BYTES = 2 * 2 ** 20;
/** Ranges at a time; a browser has six connections to a server of HTTP/1.1. */
const MAX_REQUESTS = 4;
const MAX_PLAN_BYTES = 8 * 2 ** 20;
const ABNORMAL = 1006;
const BAD_REQUEST = 400;
/** No such file, or no such bytes of it: the same request will not be answered otherwise. */
const NOT_THERE: ReadonlySet<number | undefined> = new Set([404, 416]);
const NO_PICKS = new StreamError("not_available", "picks need a connection, expected a stream without overHttp");
/** Errors that another attempt may not meet. */
const TEMPORARY: ReadonlySet<string> = new Set(["unreachable", "too_many", "draining", "damaged", "refused"]);

/** Neighbouring payloads that are fetched by one request. */
export interface PackRange {
  readonly begin: number;
  readonly end: number;
  readonly rows: readonly { readonly row: PlanRow; readonly offset: number }[];
}

/** Merge the payloads of rows into ranges, the one with the nearest segment first. */
export function rangesOf(rows: readonly PlanRow[], offsets: readonly number[]): readonly PackRange[] {
  const wanted = rows.flatMap((row, rank) => (row.follows ? [{ row, rank, offset: offsets[rank]! }] : []));
  wanted.sort((a, b) => a.offset - b.offset);
  const ranges: (PackRange & { rank: number })[] = [];
  for (const { row, rank, offset } of wanted) {
    const last = ranges.at(-1);
    const end = offset + row.bytes;
    if (last !== undefined && offset - last.end <= MAX_GAP_BYTES && end - last.begin <= MAX_RANGE_BYTES) {
      const merged = { begin: last.begin, end, rows: [...last.rows, { row, offset }], rank: Math.min(last.rank, rank) };
      ranges[ranges.length - 1] = merged;
    } else ranges.push({ begin: offset, end, rows: [{ row, offset }], rank });
  }
  return ranges.sort((a, b) => a.rank - b.rank);
}

/** As {@link Link}, for the scene at an http(s) address. */
export class HttpLink implements Connection {
  readonly #options: Omit<LinkOptions, "WebSocket">;
  readonly #access: Access;
  /** `.../scenes/ID/v-...`, once the manifest is here. */
  #folder: string | null = null;
  /** Ends what is under way: the connection, and the newest landing or prefetch. */
  #connection = new AbortController();
  #request = new AbortController();
  #attempt = 0;
  #retryTimer: ReturnType<typeof setTimeout> | undefined;
  #hasLeft = false;

  /** @param options - `url` is the scene's, ending in `/scenes/ID`. */
  constructor(options: Omit<LinkOptions, "WebSocket">) {
    this.#options = options;
    this.#access = new Access(options.token);
  }

  start(): void {
    if (!this.#hasLeft) void this.#connect();
  }

  pump(): void {
    const { session } = this.#options;
    this.#report();
    // A prefetch waits for the landing that is under way.
    if (session.hasAim && !session.awaitsAnswer) session.flushAim();
    for (const message of session.messagesToSend()) {
      if (message.type === "land" || message.type === "prefetch") void this.#answer(message);
      else if (message.type === "pick") this.#refuse(NO_PICKS, { request: message.request });
    }
  }

  reconnect(token: string | undefined): void {
    if (this.#hasLeft || (!this.#access.replace(token) && this.#folder !== null)) return;
    this.#lose();
    this.#attempt = 0;
    void this.#connect();
  }

  /** A group has no address here. */
  moveTo(): void {
    this.pump();
  }

  refuse(reason: string): void {
    this.#end(new StreamError("malformed", `the server broke the protocol: ${reason}`));
  }

  leave(): void {
    this.#hasLeft = true;
    this.#lose();
  }

  async #connect(): Promise<void> {
    const { session, url, onLinkState } = this.#options;
    this.#attempt += 1;
    this.#connection = new AbortController();
    const { signal } = this.#connection;
    onLinkState({ state: "connecting", attempt: this.#attempt });
    try {
      const json = await fetchJson(url, { token: await this.#access.show(), signal });
      const { manifest, baseFaces, folder } = checkManifest(json, "");
      signal.throwIfAborted();
      this.#folder = `${url}/${folder}`;
      onLinkState({ state: "open" });
      session.connected();
      session.take({
        type: "welcome",
        server: "",
        session: "",
        scene: {
          id: manifest.id,
          name: manifest.name,
          version: manifest.version,
          segment_count: manifest.segmentCount,
          base_faces: baseFaces,
          levels: manifest.levels,
        },
        limits: {
          max_radius_m: Number.MAX_VALUE,
          max_message_bytes: 1,
          max_messages_per_s: 1e9,
          max_credit_bytes: 1,
          idle_timeout_s: 0,
          groups: "none",
        },
      });
      this.pump();
    } catch (error) {
      if (!signal.aborted) this.#end(asStreamError(error));
    }
  }

  /** Carry out a landing or a prefetch; a newer one ends it. */
  async #answer(message: ClientMessage<"land" | "prefetch">): Promise<void> {
    const { session } = this.#options;
    this.#request.abort();
    this.#request = new AbortController();
    const signal = AbortSignal.any([this.#connection.signal, this.#request.signal]);
    try {
      const { plan, packUrl } = await this.#plan(message, signal);
      signal.throwIfAborted();
      if (message.type === "land") session.take(plan);
      this.pump();
      const ranges = [...rangesOf(plan.show, plan.offsets ?? [])];
      const fetchRanges = async (): Promise<void> => {
        for (let range = ranges.shift(); range !== undefined; range = ranges.shift()) {
          await this.#fetchRange(packUrl, range, signal);
        }
      };
      await Promise.all(Array.from({ length: MAX_REQUESTS }, fetchRanges));
      signal.throwIfAborted();
      // What the pack lacks is asked for once more by the session, then left out.
      if (message.type === "land") session.take({ type: "ready", generation: message.generation });
      this.#attempt = 0;
      this.pump();
    } catch (error) {
      if (signal.aborted) return;
      const failure = asStreamError(error);
      if (failure.status === BAD_REQUEST) this.#refuse(failure, { generation: message.generation });
      else this.#end(failure);
    }
  }

  async #plan(
    { generation, position, radius_m, coarse_radius_m, have, without, ...others }: ClientMessage<"land" | "prefetch">,
    signal: AbortSignal,
  ): Promise<{ plan: ServerMessage<"plan">; packUrl: string }> {
    const { budgets } = this.#options.session.options;
    const [x, y, z] = position;
    const query = {
      x,
      y,
      z,
      radius_m,
      coarse_radius_m,
      inner_radius_m: "inner_radius_m" in others ? others.inner_radius_m : undefined,
      without: without?.join(","),
      max_triangles: budgets.maxTriangles,
      max_bytes: budgets.maxBytes,
      max_segments: budgets.maxSegments,
      max_gpu_bytes: budgets.maxGpuBytes,
      gpu_vertex_bytes: budgets.gpuVertexBytes,
      gpu_face_bytes: budgets.gpuFaceBytes,
    };
    const given = Object.entries(query).filter((entry): entry is [string, string | number] => entry[1] !== undefined);
    const url = `${this.#folder}/plan?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}`;
    const request = { token: await this.#access.show(), signal };
    const message = decodeMessage(await fetchBytes(url, request, { maxBytes: MAX_PLAN_BYTES, isExact: false }));
    if (message?.type !== "plan" || message.pack === undefined || message.offsets?.length !== message.show.length) {
      throw new StreamError("damaged", `${url} is not a plan with places in the pack`);
    }
    const held = new Set(have);
    const show = message.show.map((row) => ({ ...row, follows: !held.has(row.key) }));
    return { plan: { ...message, generation, show }, packUrl: new URL(message.pack, url).href };
  }

  /**
   * Fetch the payloads of a range. A range that the pack lacks, or has in another length, is passed over.
   *
   * @throws StreamError for any other failure: nothing is known of the segments then, and they must not be left out.
   */
  async #fetchRange(packUrl: string, { begin, end, rows }: PackRange, signal: AbortSignal): Promise<void> {
    const { session, url } = this.#options;
    // The token is the service's: nobody else is shown it.
    const token = new URL(packUrl).origin === new URL(url).origin ? await this.#access.show() : undefined;
    let bytes: Uint8Array<ArrayBuffer>;
    try {
      const range = { begin, end };
      bytes = await fetchBytes(packUrl, { token, signal, range }, { maxBytes: end - begin, isExact: true });
    } catch (error) {
      if (signal.aborted || !(error instanceof StreamError)) throw error;
      if (error.code === "damaged" || NOT_THERE.has(error.status)) return;
      throw error;
    }
    session.payloadBytes += bytes.length;
    for (const { row, offset } of rows) {
      session.takeSegment(row.key, bytes.slice(offset - begin, offset - begin + row.bytes));
    }
    this.pump();
  }

  #refuse({ code, message }: StreamError, what: { readonly generation?: number; readonly request?: number }): void {
    this.#options.session.take({ type: "error", code, message, fatal: false, ...what });
    this.#report();
  }

  #report(): void {
    const events = this.#options.session.events();
    if (events.length > 0) this.#options.handle(events);
  }

  #lose(): void {
    clearTimeout(this.#retryTimer);
    this.#connection.abort();
    this.#folder = null;
    this.#options.session.connectionLost();
    this.#report();
  }

  /** Try again after a while, or stop where that would be no use. A version that is gone makes place for a newer one. */
  #end(error: StreamError): void {
    if (this.#hasLeft) return;
    const wasOpen = this.#folder !== null;
    this.#lose();
    const { code, message } = error;
    const end = { closeCode: ABNORMAL, code, message };
    if (!TEMPORARY.has(code) && !(code === "unknown_scene" && wasOpen)) {
      this.#options.onLinkState({ state: "closed", ...end });
      return;
    }
    const retryInMs = waitMs(Math.max(0, this.#attempt - 1), Math.random());
    this.#retryTimer = setTimeout(() => void this.#connect(), retryInMs);
    this.#options.onLinkState({ state: "waiting", attempt: this.#attempt + 1, retryInMs, ...end });
  }
}
