/**
 * A session and its connection, put together: what {@link Stream} promises, in the thread that it is made in.
 *
 * `openStream` runs it in a worker, `openDirectStream` in the calling thread.
 */

import type { GroupCommand } from "../group-types.ts";
import { prepareHash, xxh3 } from "../payload/hash.ts";
import { StreamError } from "../scene/errors.ts";
import { streamUrl } from "../scene/urls.ts";
import { checkGroup } from "../session/checks.ts";
import type { SessionEvent } from "../session/events.ts";
import { ClientSession } from "../session/session.ts";
import type {
  AttributeScale,
  LandOptions,
  LinkState,
  MeshData,
  PickHit,
  PlanFacts,
  SegmentFacts,
  SegmentSummary,
  StreamEvent,
  StreamOptions,
  StreamStats,
  Vec3,
} from "../types.ts";
import type { PlanMessage } from "../wire/messages.generated.ts";
import { sharedNowMs } from "./clock.ts";
import type { DiskShelf } from "./disk-shelf.ts";
import { Link } from "./link.ts";
import { sessionOptionsOf } from "./stream-options.ts";
import { asStreamError } from "./worker-errors.ts";

/** Picks that wait for an answer; a server answers far fewer at a time. */
const MAX_PICKS = 64;

/** What {@link StreamCore} works with. */
export interface StreamCorePlatform {
  readonly WebSocket: typeof WebSocket;
  /** Decode a payload; it must not change the bytes. */
  readonly decode: (
    payload: Uint8Array<ArrayBuffer>,
    segment: number,
    attributes: readonly AttributeScale[],
  ) => Promise<MeshData>;
  /** Payloads of earlier visits, and where those of this one are kept. */
  readonly disk?: DiskShelf | undefined;
  /** Takes the events, in order. */
  readonly emit: (events: readonly StreamEvent[]) => void;
}

interface Answer {
  readonly resolve: (hit: PickHit | null) => void;
  readonly reject: (error: StreamError) => void;
}

/** One stream in this thread. */
export class StreamCore {
  readonly #platform: StreamCorePlatform;
  readonly #session: ClientSession;
  readonly #link: Link;
  readonly #picks = new Map<number, Answer>();
  /** When each landing that is not over was asked for, by its number. */
  readonly #askedMs = new Map<number, number>();
  readonly #cacheBytes: number;
  readonly #sceneUrl: string;
  #closed = false;
  /** Why nothing is sent any more, until `reconnect`. */
  #ended: StreamError | null = null;

  /** @throws RangeError or StreamError on options that cannot be. */
  constructor(options: StreamOptions, platform: StreamCorePlatform) {
    this.#platform = platform;
    const { cacheBytes, ...sessionOptions } = sessionOptionsOf(options);
    this.#cacheBytes = cacheBytes;
    this.#sceneUrl = options.sceneUrl;
    this.#session = new ClientSession(sessionOptions, cacheBytes, xxh3);
    this.#link = new Link({
      session: this.#session,
      url: streamUrl(options.sceneUrl),
      token: options.token,
      WebSocket: platform.WebSocket,
      handle: (events) => this.#handle(events),
      onLinkState: (link) => this.#onLink(link),
    });
  }

  /** Connect, once hashes can be computed. Rejects where they cannot. */
  async start(): Promise<void> {
    await prepareHash();
    // Before the first hello, which offers them; what does not fit this version the server tells to drop.
    for (const entry of (await this.#platform.disk?.restore(this.#cacheBytes)) ?? []) this.#session.holdings.put(entry);
    if (!this.#closed) this.#link.start();
  }

  /** As {@link Stream.land}; `askedMs` is {@link sharedNowMs} when the page asked. */
  land(position: Vec3, radiusM: number, options: LandOptions = {}, askedMs = sharedNowMs()): number {
    const number = this.#session.land(position, radiusM, options);
    this.#askedMs.set(number, askedMs);
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
      // The old seat is left where it is; where several processes serve, the address says where the new group lives (wire
      // protocol, 16.6), and the seat is asked for with the next welcome.
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

  async mesh(segment: number, attributes: readonly AttributeScale[]): Promise<MeshData> {
    if (this.#closed) throw closedHere();
    // Peeked at: what is drawn is pinned anyway, and decoding must not change what is evicted first.
    const entry = this.#session.holdings.peek(segment);
    if (entry === undefined) throw new StreamError("not_held", `segment ${segment} is not held`);
    try {
      return await this.#platform.decode(entry.payload, segment % this.#session.segmentCount, attributes);
    } catch (error) {
      throw asStreamError(error);
    }
  }

  stats(): StreamStats {
    const { aims, holdings, payloadBytes, repeatedBytes } = this.#session;
    return {
      payloadBytes,
      repeatedBytes,
      heldSegments: holdings.count,
      heldBytes: holdings.cacheBytes,
      aimedLandings: aims.landings,
      aimHits: aims.hits,
      prefetchedBytes: aims.prefetchedBytes,
      usedPrefetchedBytes: aims.usedBytes,
    };
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
    this.#end(closedHere());
  }

  // ---- private

  #onLink(link: LinkState): void {
    if (link.state === "closed") this.#end(new StreamError(link.code, link.message, link.closeCode));
    this.#platform.emit([{ type: "link", link }]);
  }

  /** Nobody answers any more: tell whoever waits. */
  #end(error: StreamError): void {
    this.#ended = error;
    for (const [request, { reject }] of this.#picks) {
      // Else a reconnect would ask once more, for nobody.
      this.#session.dropPick(request);
      reject(error);
    }
    this.#picks.clear();
  }

  #handle(events: readonly SessionEvent[]): void {
    // In one batch: out of a worker each message is a task of the page's thread.
    const streamEvents: StreamEvent[] = [];
    for (const event of events) {
      const streamEvent = this.#translated(event);
      if (streamEvent !== null) streamEvents.push(streamEvent);
    }
    if (streamEvents.length > 0 && !this.#closed) this.#platform.emit(streamEvents);
  }

  /**
   * The page's event for a session's; null for none. Answers settle the promise of their question, and times are taken here:
   * the session has no clock.
   */
  #translated(event: SessionEvent): StreamEvent | null {
    switch (event.type) {
      case "opened": {
        const { session, changed, heldCount } = event;
        const maxRadiusM = event.limits.max_radius_m;
        return { type: "opened", sceneVersion: event.scene.version, session, changed, maxRadiusM, heldCount };
      }
      case "planned":
        return { type: "planned", plan: planFacts(event.landing, event.plan) };
      case "arrived":
        this.#platform.disk?.put(event.entry);
        return { type: "arrived", landing: event.landing, facts: summaryOf(event.entry.facts) };
      case "ready": {
        const { landing, visible, missing, payloadBytes } = event;
        const readyAtMs = sharedNowMs();
        const elapsedMs = Math.max(0, readyAtMs - (this.#askedMs.get(landing) ?? readyAtMs));
        this.#askedMs.delete(landing);
        return { type: "ready", landing, visible, missing, elapsedMs, readyAtMs, payloadBytes };
      }
      case "prefetching":
      case "prefetched":
        return { type: event.type, segments: event.segments, bytes: event.bytes };
      case "superseded":
        this.#askedMs.delete(event.landing);
        return event;
      case "refused":
        if (event.landing !== null) this.#askedMs.delete(event.landing);
        return event;
      case "degraded":
      case "dropped":
      case "notice":
      case "group":
        return event;
      case "rejected":
        return null;
      case "pick-answered":
        this.#answer(event.request)?.resolve(event.hit);
        return null;
      case "pick-refused":
        this.#answer(event.request)?.reject(new StreamError(event.code, event.message));
        return null;
    }
  }

  #answer(request: number): Answer | undefined {
    const answer = this.#picks.get(request);
    this.#picks.delete(request);
    return answer;
  }
}

/** Omit the hash, a bigint, which JSON cannot represent. */
function summaryOf({ xxh3: _, ...summary }: SegmentFacts): SegmentSummary {
  return summary;
}

function planFacts(landing: number, plan: PlanMessage): PlanFacts {
  const reachM = plan.effective_radius_m;
  return {
    landing,
    position: plan.position,
    radiusM: plan.radius_m,
    effectiveRadiusM: Math.min(reachM, plan.radius_m),
    coarseRadiusM: reachM > plan.radius_m ? reachM : null,
    load: plan.load.map(summaryOf),
    keep: plan.keep,
    nearby: plan.nearby,
    loadBytes: plan.load_bytes,
    totalBytes: plan.total_bytes,
    totalTriangles: plan.total_triangles,
    omittedSegments: plan.omitted_segments,
    omittedBy: plan.omitted_by ?? null,
  };
}

function closedHere(): StreamError {
  return new StreamError("closed", "the stream was closed here");
}
