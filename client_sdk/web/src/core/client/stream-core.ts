/**
 * A session and its connection, put together: what {@link Stream} promises, in the thread that it is made in.
 *
 * `openStream` runs it in a worker, `openDirectStream` in the calling thread.
 */

import { checkGroup } from "../extras/group-state.ts";
import type { GroupCommand } from "../extras/group-types.ts";
import { inflate } from "../payload/gzip.ts";
import { segmentBounds } from "../payload/segment-format.ts";
import { StreamError } from "../scene/errors.ts";
import { parseSceneUrl, sceneUrlOf, streamUrl } from "../scene/urls.ts";
import type { SessionEvent } from "../session/events.ts";
import { ClientSession } from "../session/session.ts";
import type {
  AttributeScale,
  FaceBits,
  LandOptions,
  LinkState,
  MeshData,
  PickHit,
  PlanFacts,
  SegmentFacts,
  SegmentKey,
  StreamEvent,
  StreamOptions,
  StreamStats,
  Vec3,
} from "../types.ts";
import type { PlanRow } from "../wire/messages.ts";
import { sharedNowMs } from "./clock.ts";
import type { DiskCache } from "./disk-cache.ts";
import { HttpLink } from "./http-link.ts";
import { type Connection, Link, type LinkOptions } from "./link.ts";
import { sessionOptionsOf } from "./stream-options.ts";
import { asStreamError } from "./worker-errors.ts";

/** Picks that wait for an answer; a server answers far fewer at a time. */
const MAX_PICKS = 64;
/** Close code of a connection that ended without one. */
const ABNORMAL = 1006;
/** Codes of {@link StreamError} that say nothing about the payload. */
const NOT_DAMAGE: ReadonlySet<string> = new Set(["closed", "not_held", "too_many"]);

/** What {@link StreamCore} works with. */
export interface StreamCorePlatform {
  readonly WebSocket: typeof WebSocket;
  /** Decode a payload; it must not change the bytes. */
  readonly decode: (payload: Uint8Array<ArrayBuffer>, attributes: readonly AttributeScale[]) => Promise<MeshData>;
  /** Payloads of earlier visits, and where those of this one are kept. */
  readonly disk?: DiskCache | undefined;
  /** Takes the events, in order. It must not throw. */
  readonly emit: (event: StreamEvent) => void;
}

interface Answer {
  readonly resolve: (hit: PickHit | null) => void;
  readonly reject: (error: StreamError) => void;
}

/** A landing that is not complete. */
interface Pending {
  readonly askedMs: number;
  readonly stallMs: number | undefined;
  deadline: ReturnType<typeof setTimeout> | undefined;
  stall: ReturnType<typeof setTimeout> | undefined;
}

/** One stream in this thread. */
export class StreamCore {
  readonly #platform: StreamCorePlatform;
  readonly #session: ClientSession;
  readonly #link: Connection;
  readonly #picks = new Map<number, Answer>();
  readonly #pending = new Map<number, Pending>();
  readonly #cacheBytes: number;
  readonly #sceneUrl: string;
  /** Events are handed out in order, though some wait for what is inflated. */
  #emitted: Promise<void> = Promise.resolve();
  #closed = false;
  /** Why nothing is sent any more, until `reconnect`. */
  #ended: StreamError | null = null;

  /** @throws RangeError or StreamError on options that cannot be. */
  constructor(options: StreamOptions, platform: StreamCorePlatform) {
    this.#platform = platform;
    const { cacheBytes, ...sessionOptions } = sessionOptionsOf(options);
    this.#cacheBytes = cacheBytes;
    this.#sceneUrl = options.sceneUrl;
    this.#session = new ClientSession(sessionOptions, cacheBytes);
    const isOverHttp = options.overHttp === true;
    const linkOptions: LinkOptions = {
      session: this.#session,
      url: isOverHttp ? httpUrlOf(options.sceneUrl) : streamUrl(options.sceneUrl),
      token: options.token,
      WebSocket: platform.WebSocket,
      handle: (events) => this.#handle(events),
      onLinkState: (link) => this.#onLink(link),
    };
    this.#link = isOverHttp ? new HttpLink(linkOptions) : new Link(linkOptions);
  }

  /** Connect, when the payloads of earlier visits are here. */
  async start(): Promise<void> {
    for (const entry of (await this.#platform.disk?.restore(this.#cacheBytes)) ?? []) this.#session.cache.put(entry);
    if (!this.#closed) this.#link.start();
  }

  /** As {@link Stream.land}; `askedMs` is {@link sharedNowMs} when the page asked. */
  land(position: Vec3, radiusM: number, options: LandOptions = {}, askedMs = sharedNowMs()): number {
    const number = this.#session.land(position, radiusM, options);
    const { deadlineMs, stallMs } = options;
    const hurryAfter = (ms: number) => setTimeout(() => this.#hurry(number), ms);
    this.#pending.set(number, {
      askedMs,
      stallMs,
      deadline: deadlineMs === undefined ? undefined : hurryAfter(deadlineMs),
      stall: stallMs === undefined ? undefined : hurryAfter(stallMs),
    });
    this.#link.pump();
    return number;
  }

  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    this.#session.aim(position, radiusM, coarseRadiusM);
    this.#link.pump();
  }

  group(command: GroupCommand): void {
    checkGroup(command);
    if (command.type === "join") {
      // The old seat is left where it is. Where several processes serve, the address says where the new group is (protocol,
      // section 10): its seat is asked for with the next welcome.
      this.#session.group({ type: "leave" });
      this.#link.moveTo(streamUrl(this.#sceneUrl, command.group));
    }
    this.#session.group(command);
    this.#link.pump();
  }

  async pick(origin: Vec3, direction?: Vec3): Promise<PickHit | null> {
    if (this.#ended !== null) throw this.#ended;
    if (this.#picks.size >= MAX_PICKS) {
      throw new StreamError("too_many", `${MAX_PICKS} picks wait for an answer already`);
    }
    const request = this.#session.pick(origin, direction);
    const answer = new Promise<PickHit | null>((resolve, reject) => this.#picks.set(request, { resolve, reject }));
    this.#link.pump();
    return answer;
  }

  async mesh(key: SegmentKey, attributes: readonly AttributeScale[]): Promise<MeshData> {
    if (this.#closed) throw closedHere();
    // Without a change of its age: decoding must not change what is evicted first.
    const entry = this.#session.cache.peek(key);
    if (entry === undefined) throw new StreamError("not_held", `segment ${key} is not in memory`);
    try {
      return await this.#platform.decode(entry.payload, attributes);
    } catch (error) {
      const failure = asStreamError(error);
      if (failure.code === "no_decoder") this.#giveUp(failure);
      else if (!this.#closed && !NOT_DAMAGE.has(failure.code)) {
        this.#session.damaged(key);
        this.#link.pump();
      }
      throw failure;
    }
  }

  stats(): StreamStats {
    const { cache, payloadBytes, repeatedBytes, aimedLandings, aimHits } = this.#session;
    return { payloadBytes, repeatedBytes, heldSegments: cache.size, heldBytes: cache.bytes, aimedLandings, aimHits };
  }

  reconnect(token?: string): void {
    if (this.#closed) return;
    this.#ended = null;
    this.#link.reconnect(token);
  }

  close(): void {
    if (this.#closed) return;
    this.#closed = true;
    this.#link.leave();
    for (const landing of [...this.#pending.keys()]) this.#settle(landing);
    this.#end(closedHere());
  }

  // ---- private

  #onLink(link: LinkState): void {
    if (link.state === "closed") this.#end(new StreamError(link.code, link.message, link.closeCode));
    this.#emit(async () => ({ type: "link", link }));
  }

  /** Nobody answers any more: reject what waits. */
  #end(error: StreamError): void {
    this.#ended = error;
    for (const [request, { reject }] of this.#picks) {
      this.#session.dropPick(request);
      reject(error);
    }
    this.#picks.clear();
  }

  /** Nothing can be decoded any more: a connection would be of no use. */
  #giveUp({ message }: StreamError): void {
    if (this.#closed || this.#ended !== null) return;
    this.#link.leave();
    this.#onLink({ state: "closed", closeCode: ABNORMAL, code: "worker_failed", message });
  }

  #hurry(landing: number): void {
    this.#session.hurry(landing);
    this.#link.pump();
  }

  /** A landing is over, or complete; returns when it was asked for. */
  #settle(landing: number): number {
    const pending = this.#pending.get(landing);
    clearTimeout(pending?.deadline);
    clearTimeout(pending?.stall);
    this.#pending.delete(landing);
    return pending?.askedMs ?? sharedNowMs();
  }

  #handle(events: readonly SessionEvent[]): void {
    for (const event of events) this.#on(event);
  }

  /** Answers settle the promise of their question, and times are taken here: the session has no clock. */
  #on(event: SessionEvent): void {
    switch (event.type) {
      case "opened": {
        const { session, changed } = event;
        const [sceneVersion, maxRadiusM] = [event.scene.version, event.limits.max_radius_m];
        this.#emit(async () => ({ type: "opened", sceneVersion, session, changed, maxRadiusM }));
        // What was shown belongs to the version before; the user is still there.
        if (changed) this.#session.landAgain();
        break;
      }
      case "whole":
        void this.#check(event.key, event.payload);
        break;
      case "planned":
        this.#emit(() => this.#planned(event));
        break;
      case "arrived": {
        for (const [landing, pending] of this.#pending) this.#restartStall(landing, pending);
        const entry = this.#session.cache.peek(event.key);
        if (entry !== undefined) this.#platform.disk?.put(entry);
        this.#emit(async () => event);
        break;
      }
      case "degraded": {
        const { landing, rows } = event;
        const segments = rows.map(({ key }) => key);
        this.#emit(async () => ({ type: "degraded", landing, segments, hidden: await this.#bits(event.hidden) }));
        break;
      }
      case "ready": {
        const { landing, rows, missing, payloadBytes } = event;
        const readyAtMs = sharedNowMs();
        const elapsedMs = Math.max(0, readyAtMs - this.#settle(landing));
        const visible = rows.map(({ key }) => key);
        const facts = { landing, visible, missing, elapsedMs, readyAtMs, payloadBytes };
        this.#emit(async () => ({ type: "ready", ...facts, hidden: await this.#bits(event.hidden) }));
        break;
      }
      case "pick-answered":
        this.#answer(event.request)?.resolve(event.hit);
        break;
      case "pick-refused":
        this.#answer(event.request)?.reject(new StreamError(event.code, event.message));
        break;
      default:
        if ((event.type === "superseded" || event.type === "refused") && event.landing !== null) {
          this.#settle(event.landing);
        }
        this.#emit(async () => event);
    }
  }

  #restartStall(landing: number, pending: Pending): void {
    if (pending.stallMs === undefined) return;
    clearTimeout(pending.stall);
    pending.stall = setTimeout(() => this.#hurry(landing), pending.stallMs);
  }

  /** Check a payload that is whole. */
  async #check(key: SegmentKey, payload: Uint8Array<ArrayBuffer>): Promise<void> {
    try {
      this.#session.checked(key, await segmentBounds(payload));
    } catch {
      this.#session.damaged(key);
    }
    if (!this.#closed) this.#link.pump();
  }

  /** Hand an event out behind those before it. */
  #emit(event: () => Promise<StreamEvent>): void {
    const translated = event();
    this.#emitted = this.#emitted.then(async () => {
      try {
        const next = await translated;
        if (!this.#closed) this.#platform.emit(next);
      } catch (error) {
        this.#link.refuse(error instanceof Error ? error.message : String(error));
      }
    });
  }

  /** Inflate hidden faces, to as many as the base mesh has. */
  async #bits(packed: Uint8Array<ArrayBuffer>): Promise<FaceBits> {
    const bytes = Math.ceil(this.#session.baseFaces / 8);
    const bits = await inflate(packed, bytes);
    if (bits.length !== bytes) throw new Error(`got ${bits.length} bytes of hidden faces, expected ${bytes}`);
    return bits;
  }

  async #planned({
    landing,
    position,
    radiusM,
    plan,
  }: Extract<SessionEvent, { type: "planned" }>): Promise<StreamEvent> {
    const { effective_radius_m: reachM, omitted: omittedSegments, omitted_by: omittedBy = null } = plan;
    const sum = (of: (row: PlanRow) => number) => plan.show.reduce((total, row) => total + of(row), 0);
    const facts: PlanFacts = {
      landing,
      position,
      radiusM,
      effectiveRadiusM: Math.min(reachM, radiusM),
      coarseRadiusM: reachM > radiusM ? reachM : null,
      show: plan.show.map(factsOf),
      hidden: await this.#bits(plan.hidden),
      loadBytes: sum(({ bytes, follows }) => (follows ? bytes : 0)),
      totalBytes: sum(({ bytes }) => bytes),
      totalTriangles: sum(({ faces }) => faces),
      omittedSegments,
      omittedBy,
    };
    return { type: "planned", plan: facts };
  }

  #answer(request: number): Answer | undefined {
    const answer = this.#picks.get(request);
    this.#picks.delete(request);
    return answer;
  }
}

function factsOf({ key, id: segment, bytes, faces, vertices, follows, isCoarser }: PlanRow): SegmentFacts {
  return { key, segment, isCoarser, bytes, faces, vertices, follows };
}

/** The scene's own address, in the form that requests are made to. */
function httpUrlOf(sceneUrl: string): string {
  const { server, scene } = parseSceneUrl(sceneUrl);
  if (scene === null) throw new StreamError("invalid_url", `${server} names no scene, expected .../scenes/ID`);
  return sceneUrlOf(server, scene);
}

function closedHere(): StreamError {
  return new StreamError("closed", "the stream was closed here");
}
