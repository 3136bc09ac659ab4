/**
 * The client's side of protocol 2: messages in; events and messages to send out.
 *
 * The owner has sockets, clocks and workers. It passes in commands and received messages, and after each call drains
 * {@link ClientSession.events} and {@link ClientSession.messagesToSend}. Section numbers are those of `spec/protocol.md`.
 *
 * The server keeps no table of what the client has: every `land` lists it. Segments that a landing listed, or that came
 * since, stay in memory until it is complete.
 *
 * PURE.
 */

import { GroupState } from "../extras/group-state.ts";
import type { GroupCommand } from "../extras/group-types.ts";
import type { Bounds, Budgets, LandOptions, PickHit, Vec3 } from "../types.ts";
import { DecodeError } from "../wire/errors.ts";
import { decodeFrame, isFrame } from "../wire/frames.ts";
import type { SegmentKey } from "../wire/kinds.ts";
import type { ClientMessage, PlanRow, ServerMessage } from "../wire/messages.ts";
import { decodeMessage, encodeMessage, MAX_HAVE, MAX_WITHOUT } from "../wire/messages.ts";
import { type CachedSegment, SegmentCache } from "./cache.ts";
import type { SessionEvent } from "./events.ts";

/** Deliveries of a damaged segment before its key is left out (4, rule 8). */
const MAX_FAILURES = 2;

/** What a session says in `hello`. */
export interface SessionOptions {
  /** Name and version of the client, for the server's logs. */
  readonly client: string;
  readonly budgets: Budgets;
  /** Payload bytes that may be under way. Half of it is granted again at a time. */
  readonly creditBytes: number;
}

/** The message that opens a connection. */
export function helloMessage({ client, budgets, creditBytes }: SessionOptions): ClientMessage<"hello"> {
  return {
    type: "hello",
    client,
    budgets: {
      max_triangles: budgets.maxTriangles,
      max_bytes: budgets.maxBytes,
      max_segments: budgets.maxSegments,
      max_gpu_bytes: budgets.maxGpuBytes,
      gpu_vertex_bytes: budgets.gpuVertexBytes,
      gpu_face_bytes: budgets.gpuFaceBytes,
    },
    credit_bytes: creditBytes,
  };
}

/** The server sent what the protocol does not allow: the connection must be closed with 4400. */
export class ProtocolViolation extends Error {
  override readonly name = "ProtocolViolation";
}

type Place = Omit<ClientMessage<"prefetch">, "type">;

/** A landing that the user asked for. It may be sent several times, as generations. */
class Landing {
  /** Whether the inner set is enough. */
  isUrgent = false;
  /** As it was sent last; null while it waits to be sent. */
  generation: number | null = null;
  plan: ServerMessage<"plan"> | null = null;
  ready: ServerMessage<"ready"> | null = null;
  /** Keys of the plan that are not in memory and checked, and not missing. */
  readonly waiting = new Set<SegmentKey>();
  /** Until the plan is here: keys that `have` listed, and those that came since. */
  protected = new Set<SegmentKey>();
  readonly failures = new Map<SegmentKey, number>();
  /** Keys that failed too often. */
  readonly without = new Set<SegmentKey>();
  payloadBytes = 0;

  constructor(
    readonly number: number,
    readonly position: Vec3,
    readonly radiusM: number,
    readonly options: LandOptions,
  ) {}

  /** Keys that must not leave memory before it is complete. */
  get needed(): Iterable<SegmentKey> {
    return this.plan === null ? this.protected : this.plan.show.map(({ key }) => key);
  }

  /** The first `count` rows of the plan that are not missing. */
  rows(count?: number): PlanRow[] {
    const missing = new Set(this.ready?.missing);
    return (this.plan?.show ?? []).slice(0, count).filter(({ key }) => !missing.has(key));
  }

  /** Wait to be sent again; the segments that it has stay in memory. */
  reset(): void {
    this.protected = new Set(this.needed);
    this.generation = null;
    this.plan = null;
    this.ready = null;
    this.waiting.clear();
  }
}

/** State of one session. It outlives connections. */
export class ClientSession {
  readonly options: SessionOptions;
  readonly cache: SegmentCache;
  /** Scene version of the newest connection. */
  version: string | null = null;
  baseFaces = 0;
  /** Payload bytes received. */
  payloadBytes = 0;
  /** Payload bytes of segments that were in memory already; 0 with a right server. */
  repeatedBytes = 0;
  /** Landings with an aim before them, and those of them of which nothing had to follow. */
  aimedLandings = 0;
  aimHits = 0;
  /** Keys of what the newest complete landing shows. */
  shownKeys: ReadonlySet<SegmentKey> = new Set();
  #events: SessionEvent[] = [];
  #outbox: ClientMessage[] = [];
  #isOpen = false;
  #isGreeting = false;
  #generation = 0;
  #landings = 0;
  #requests = 0;
  /** Landings that are neither complete nor over, oldest first. The others go on if the server refuses the last one. */
  #open: Landing[] = [];
  /** The newest landing that is complete. */
  #complete: Landing | null = null;
  #aim: Omit<Place, "generation" | "have" | "taken_bytes"> | null = null;
  #hasAimed = false;
  readonly #picks = new Map<number, ClientMessage<"pick">>();
  readonly #group: GroupState;
  /** The segment of which a part has come. */
  #part: { readonly key: SegmentKey; readonly payload: Uint8Array<ArrayBuffer>; length: number } | null = null;
  #takenBytes = 0;
  #grantedBytes = 0;
  #acknowledgedBytes = 0;
  #creditStep = 1;
  #maxRadiusM = Number.POSITIVE_INFINITY;

  /** @throws RangeError for options that the protocol does not allow. */
  constructor(options: SessionOptions, cacheBytes: number) {
    encodeMessage(helloMessage(options));
    this.options = options;
    this.cache = new SegmentCache(cacheBytes);
    this.#group = new GroupState({
      send: (message) => this.#outbox.push(message),
      report: (event) => this.#events.push(event),
      isOpen: () => this.#isOpen,
    });
  }

  /** Whether the server owes an answer. */
  get awaitsAnswer(): boolean {
    return this.#isGreeting || this.#picks.size > 0 || this.#open.some(({ generation }) => generation !== null);
  }

  /** Whether an aim waits for {@link flushAim}. */
  get hasAim(): boolean {
    return this.#aim !== null && this.#isOpen;
  }

  /** Return, once, what has happened since the last call. */
  events(): SessionEvent[] {
    const events = this.#events;
    this.#events = [];
    return events;
  }

  /**
   * Return, once, the messages to send. A `land` is built here, from what is held now: however often the user lands before
   * the owner can send, one is sent.
   */
  messagesToSend(): ClientMessage[] {
    const messages = this.#outbox.splice(0);
    const landing = this.#open.at(-1);
    const isLeaving = messages.some(({ type }) => type === "bye");
    if (landing !== undefined && landing.generation === null && this.#isOpen && !isLeaving) {
      messages.push(this.#landMessage(landing));
    }
    return messages;
  }

  // ---- connection

  /** A connection is there. */
  connected(): void {
    this.#outbox.length = 0;
    this.#isOpen = false;
    this.#isGreeting = true;
    this.#generation = 0;
    this.#takenBytes = 0;
    this.#acknowledgedBytes = 0;
    this.#grantedBytes = this.options.creditBytes;
    this.#outbox.push(helloMessage(this.options));
  }

  /** It is gone. The newest open landing, picks and the seat in a group wait for the next one. */
  connectionLost(): void {
    this.#isOpen = false;
    this.#isGreeting = false;
    this.#outbox.length = 0;
    this.#part = null;
    this.#endBefore(this.#open.at(-1));
    for (const landing of this.#open) landing.reset();
    this.#group.connectionLost();
  }

  /**
   * Take one whole WebSocket message.
   *
   * @throws ProtocolViolation
   */
  receive(data: Uint8Array | string): void {
    try {
      if (isFrame(data)) {
        const frame = decodeFrame(data);
        if (frame !== null) this.#onFrame(frame.key, frame.offset, frame.total, frame.data);
      } else {
        const message = decodeMessage(data);
        if (message !== null) this.take(message);
      }
    } catch (error) {
      if (error instanceof DecodeError) throw new ProtocolViolation(error.message, { cause: error });
      throw error;
    }
  }

  // ---- commands

  /**
   * Land; it supersedes every landing that is not complete. Returns its number in the events.
   *
   * @throws RangeError for a number that the protocol does not allow; nothing has changed.
   */
  land(position: Vec3, radiusM: number, options: LandOptions = {}): number {
    checkLand(position, radiusM, options);
    this.#landings += 1;
    const landing = new Landing(this.#landings, position, radiusM, options);
    this.#aim = null;
    const last = this.#open.at(-1);
    if (last !== undefined && last.generation === null) {
      this.#open.pop();
      this.#events.push({ type: "superseded", landing: last.number, by: landing.number });
    }
    this.#open.push(landing);
    return landing.number;
  }

  /** Ask for the newest complete landing once more after a change of version, whichever segments failed before it. */
  landAgain(): void {
    const landing = this.#complete;
    if (this.#open.length > 0 || landing === null) return;
    // It may have been given up: with more keys left out than a `land` can name.
    landing.failures.clear();
    landing.without.clear();
    landing.reset();
    this.#open.push(landing);
  }

  /** Accept the inner set of a landing from now on. */
  hurry(number: number): void {
    for (const landing of this.#open) if (landing.number === number) landing.isUrgent = true;
    this.#update();
  }

  /**
   * Note where the user points; only the newest is kept until {@link flushAim}.
   *
   * @throws RangeError
   */
  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    checkLand(position, radiusM, { coarseRadiusM });
    this.#aim = { position, radius_m: radiusM, coarse_radius_m: coarseRadiusM };
    this.#hasAimed = true;
  }

  /** Send the newest aim, if there is one and the connection is open. */
  flushAim(): void {
    const aim = this.#aim;
    if (aim === null || !this.#isOpen) return;
    this.#aim = null;
    this.#outbox.push({ type: "prefetch", ...this.#place(aim.position, aim.radius_m, aim.coarse_radius_m) });
  }

  /**
   * Pick along a ray; returns the request's number in the events.
   *
   * @throws RangeError
   */
  pick(origin: Vec3, direction?: Vec3): number {
    checkPick(origin, direction);
    const pick = { type: "pick", request: this.#nextRequest(), origin, direction } as const;
    this.#picks.set(pick.request, pick);
    if (this.#isOpen) this.#outbox.push(pick);
    return pick.request;
  }

  /** Forget a pick: its answer is skipped, and it is not asked again. */
  dropPick(request: number): void {
    this.#picks.delete(request);
  }

  /** Do something in a group. Without a connection a `join` and a `gather` wait for the next welcome. */
  group(command: GroupCommand): void {
    const isRequest = command.type === "join" || command.type === "gather";
    this.#group.take(command, isRequest ? this.#nextRequest() : 0);
  }

  bye(): void {
    if (this.#isOpen) this.#outbox.push({ type: "bye" });
  }

  // ---- payload

  /** Take a whole payload, which came in any way. The event `whole` follows, where it was not here. */
  takeSegment(key: SegmentKey, payload: Uint8Array<ArrayBuffer>): void {
    if (this.cache.peek(key) !== undefined) {
      this.repeatedBytes += payload.byteLength;
      return;
    }
    this.cache.put({ key, payload, bounds: null });
    const landing = this.#open.at(-1);
    if (landing !== undefined) landing.payloadBytes += payload.byteLength;
    for (const open of this.#open) if (open.plan === null) open.protected.add(key);
    this.#events.push({ type: "whole", key, payload });
  }

  /** The payload of `whole` is right. */
  checked(key: SegmentKey, bounds: Bounds): void {
    const entry = this.cache.peek(key);
    if (entry === undefined) return;
    this.cache.put({ ...entry, bounds });
    let number: number | null = null;
    for (const landing of this.#open) if (landing.waiting.delete(key)) number = landing.number;
    this.#events.push({ type: "arrived", landing: number, key, bytes: entry.payload.byteLength, bounds });
    this.#trim();
    this.#update();
  }

  /** A payload is damaged, or cannot be decoded: it is dropped and asked for again, or left out (4, rule 8). */
  damaged(key: SegmentKey): void {
    this.cache.delete(key);
    const complete = this.#complete;
    if (this.#open.length === 0 && complete?.rows().some((row) => row.key === key)) {
      this.#open.push(complete);
      this.#retry(complete, [key]);
    }
    for (const { plan, waiting } of this.#open) if (plan?.show.some((row) => row.key === key)) waiting.add(key);
    this.#update();
  }

  // ---- messages

  /**
   * Take a message of the service.
   *
   * @throws ProtocolViolation
   */
  take(message: ServerMessage): void {
    const { type } = message;
    if (type === "welcome") this.#onWelcome(message);
    else if (type === "error") this.#onError(message);
    else if (!this.#isOpen) throw new ProtocolViolation(`got ${type} first, expected welcome or error`);
    else if (type === "plan") this.#onPlan(message);
    else if (type === "ready") this.#onReady(message);
    else if (type === "picked") {
      if (!this.#picks.delete(message.request)) return;
      this.#events.push({ type: "pick-answered", request: message.request, hit: hitOf(message) });
    } else if (type === "notice") {
      const { kind, version = null, reconnect_after_ms: reconnectAfterMs = null } = message;
      this.#events.push({ type, kind, version, reconnectAfterMs });
    } else this.#group.onMessage(message);
  }

  #onWelcome({ scene, limits, session }: ServerMessage<"welcome">): void {
    if (this.#isOpen || !this.#isGreeting) throw new ProtocolViolation("got a second welcome, expected one");
    this.#isOpen = true;
    this.#isGreeting = false;
    const changed = this.version !== null && this.version !== scene.version;
    this.version = scene.version;
    if (changed) this.shownKeys = new Set();
    // Granted in halves: the server never runs dry while a grant is on its way (6).
    this.#creditStep = Math.max(1, Math.floor(Math.min(this.options.creditBytes, limits.max_credit_bytes) / 2));
    this.baseFaces = scene.base_faces;
    this.#maxRadiusM = limits.max_radius_m;
    this.#events.push({ type: "opened", scene, limits, session, changed });
    this.#outbox.push(...this.#picks.values());
    this.#group.connected(limits);
  }

  #onError(error: ServerMessage<"error">): void {
    const { code, message, fatal, generation, request } = error;
    let isAnswer = this.#group.refused(error);
    if (request !== undefined && this.#picks.delete(request)) {
      this.#events.push({ type: "pick-refused", request, code, message });
      isAnswer = true;
    }
    if (isAnswer && !fatal) return;
    const refused = fatal || generation === undefined ? undefined : this.#landingOf(generation);
    if (refused !== undefined) this.#open.splice(this.#open.indexOf(refused), 1);
    this.#events.push({ type: "refused", code, message, fatal, landing: refused?.number ?? null });
    this.#update(); // An older landing goes on (4, rule 7).
  }

  #onPlan(plan: ServerMessage<"plan">): void {
    const landing = this.#expectLanding(plan);
    if (landing === undefined) return;
    this.#endBefore(landing);
    landing.plan = plan;
    landing.ready = null;
    for (const { key } of plan.show) if (!this.cache.get(key)?.bounds) landing.waiting.add(key);
    if (this.#hasAimed) {
      this.#hasAimed = false;
      this.aimedLandings += 1;
      if (plan.show.every(({ follows }) => !follows)) this.aimHits += 1;
    }
    const { number, position, radiusM } = landing;
    this.#events.push({ type: "planned", landing: number, position, radiusM, plan });
    this.#trim();
    this.#update();
  }

  #onReady(ready: ServerMessage<"ready">): void {
    const landing = this.#expectLanding(ready);
    if (landing?.plan == null) return;
    if (ready.missing !== undefined && ready.hidden === undefined) {
      throw new ProtocolViolation("got ready with missing segments, expected hidden faces with it");
    }
    landing.ready = ready;
    for (const key of ready.missing ?? []) landing.waiting.delete(key);
    this.#update();
  }

  #onFrame(key: SegmentKey, offset: number, total: number, data: Uint8Array): void {
    if (!this.#isOpen) throw new ProtocolViolation("got payload first, expected welcome or error");
    this.#takeCredit(data.length);
    if (offset === 0) this.#part = { key, payload: new Uint8Array(total), length: 0 };
    const part = this.#part;
    if (part?.key !== key || part.payload.length !== total || part.length !== offset) {
      const expected = part === null ? "a beginning" : `byte ${part.length} of ${part.key}`;
      throw new ProtocolViolation(`got byte ${offset} of ${key} (${total} bytes), expected ${expected}`);
    }
    part.payload.set(data, offset);
    part.length += data.length;
    if (part.length < total) return;
    this.#part = null;
    this.takeSegment(key, part.payload);
  }

  #takeCredit(bytes: number): void {
    this.payloadBytes += bytes;
    this.#takenBytes += bytes;
    if (this.#takenBytes > this.#grantedBytes) {
      throw new ProtocolViolation(`got ${this.#takenBytes} bytes of payload, expected at most ${this.#grantedBytes}`);
    }
    const granted = this.#takenBytes - this.#acknowledgedBytes;
    if (granted < this.#creditStep) return;
    this.#acknowledgedBytes = this.#takenBytes;
    this.#grantedBytes += granted;
    // A grant that waits to be sent is enlarged: what waits must not grow with what comes.
    const at = this.#outbox.findIndex(({ type }) => type === "credit");
    const waiting = this.#outbox[at];
    if (waiting?.type !== "credit") this.#outbox.push({ type: "credit", bytes: granted });
    else this.#outbox[at] = { type: "credit", bytes: waiting.bytes + granted };
  }

  // ---- landings

  /** Complete the newest landing, request it again, or offer its inner set. */
  #update(): void {
    const landing = this.#open.at(-1);
    if (landing === undefined || landing.plan === null) return;
    const { plan, ready, waiting } = landing;
    if (waiting.size === 0) {
      this.#finish(landing, plan);
      return;
    }
    const lost = [...waiting].filter((key) => this.cache.peek(key) === undefined);
    if (ready !== null && lost.length === waiting.size) {
      this.#retry(landing, lost);
    } else if (landing.isUrgent && plan.inner_count !== undefined && plan.inner_hidden !== undefined) {
      const rows = landing.rows(plan.inner_count);
      if (rows.some(({ key }) => waiting.has(key))) return;
      landing.isUrgent = false;
      this.#events.push({ type: "degraded", landing: landing.number, rows, hidden: plan.inner_hidden });
    }
  }

  #finish(landing: Landing, plan: ServerMessage<"plan">): void {
    const rows = landing.rows();
    this.#open = [];
    this.#complete = landing;
    this.shownKeys = new Set(rows.map(({ key }) => key));
    const { number, ready, without, payloadBytes } = landing;
    const missing = [...(ready?.missing ?? []), ...without];
    const hidden = ready?.hidden ?? plan.hidden;
    this.#events.push({ type: "ready", landing: number, rows, missing, hidden, payloadBytes });
    this.#trim();
  }

  /** Request a landing again after failed deliveries; give it up where more failed than may be left out. */
  #retry(landing: Landing, keys: readonly SegmentKey[]): void {
    const { number, failures, without } = landing;
    for (const key of keys) {
      const count = (failures.get(key) ?? 0) + 1;
      failures.set(key, count);
      if (count >= MAX_FAILURES) without.add(key);
    }
    landing.reset();
    if (without.size <= MAX_WITHOUT) return;
    this.#open.splice(this.#open.indexOf(landing), 1);
    const message = `got ${without.size} segments that cannot be decoded, expected at most ${MAX_WITHOUT}`;
    this.#events.push({ type: "refused", code: "damaged", message, fatal: false, landing: number });
  }

  #landMessage(landing: Landing): ClientMessage<"land"> {
    const { position, radiusM, options, without } = landing;
    const place = this.#place(position, radiusM, options.coarseRadiusM);
    landing.generation = this.#generation;
    landing.protected = new Set(place.have);
    return {
      type: "land",
      ...place,
      ...(without.size > 0 && { without: [...without].sort() }),
      inner_radius_m: options.innerRadiusM,
    };
  }

  /** The fields of a request, with what is held near that place; takes the next generation. */
  #place(position: Vec3, radiusM: number, coarseRadiusM: number | undefined): Place {
    this.#generation += 1;
    // A coarser ring that is cut to the service's bound is better than no landing.
    const ringM =
      coarseRadiusM === undefined ? undefined : Math.max(radiusM, Math.min(coarseRadiusM, this.#maxRadiusM));
    return {
      generation: this.#generation,
      position,
      radius_m: radiusM,
      coarse_radius_m: ringM,
      have: this.#heldNear(position, ringM ?? radiusM),
      taken_bytes: this.#takenBytes,
    };
  }

  /** Keys of what may be needed there, nearest first. */
  #heldNear(position: Vec3, radiusM: number): SegmentKey[] {
    const near: { readonly key: SegmentKey; readonly distanceM: number }[] = [];
    for (const entry of this.cache.entries()) {
      const distanceM = distanceTo(entry, position);
      // The server goes by the box of the finer level: a coarser one differs by a little.
      if (distanceM <= radiusM + diagonalOf(entry)) near.push({ key: entry.key, distanceM });
    }
    near.sort((a, b) => a.distanceM - b.distanceM);
    return near.slice(0, MAX_HAVE).map(({ key }) => key);
  }

  /** The landing that a message is about; undefined for one that is over. */
  #expectLanding({ type, generation }: ServerMessage<"plan" | "ready">): Landing | undefined {
    if (generation <= this.#generation) return this.#landingOf(generation);
    throw new ProtocolViolation(`got ${type} of generation ${generation}, expected at most ${this.#generation}`);
  }

  #landingOf(generation: number): Landing | undefined {
    return this.#open.find((landing) => landing.generation === generation);
  }

  /** End the landings before this one. */
  #endBefore(landing: Landing | undefined): void {
    if (landing === undefined) return;
    for (const { number } of this.#open.splice(0, this.#open.indexOf(landing))) {
      this.#events.push({ type: "superseded", landing: number, by: landing.number });
    }
  }

  #trim(): void {
    this.cache.trim(() => new Set([...this.shownKeys, ...this.#open.flatMap(({ needed }) => [...needed])]));
  }

  #nextRequest(): number {
    this.#requests += 1;
    return this.#requests;
  }
}

/** @throws RangeError for numbers that the protocol does not allow. */
export function checkLand(
  position: Vec3,
  radiusM: number,
  { coarseRadiusM, innerRadiusM }: Pick<LandOptions, "coarseRadiusM" | "innerRadiusM"> = {},
): void {
  encodeMessage({
    type: "land",
    generation: 0,
    position,
    radius_m: radiusM,
    coarse_radius_m: coarseRadiusM,
    inner_radius_m: innerRadiusM,
    have: [],
    taken_bytes: 0,
  });
}

/** @throws RangeError for numbers that the protocol does not allow. */
export function checkPick(origin: Vec3, direction: Vec3 | undefined): void {
  encodeMessage({ type: "pick", request: 0, origin, direction });
}

/** Metres from a place to the box of a segment; 0 while that is not known. */
function distanceTo({ bounds }: CachedSegment, position: Vec3): number {
  if (bounds === null) return 0;
  return Math.hypot(
    ...[0, 1, 2].map((axis) => Math.max(bounds[axis]! - position[axis]!, 0, position[axis]! - bounds[axis + 3]!)),
  );
}

function diagonalOf({ bounds }: CachedSegment): number {
  return bounds === null ? 0 : Math.hypot(...[0, 1, 2].map((axis) => bounds[axis + 3]! - bounds[axis]!));
}

function hitOf({ hit }: ServerMessage<"picked">): PickHit | null {
  if (hit === undefined) return null;
  const { position, normal, segment, region, attributes } = hit;
  return {
    position,
    normal,
    segment,
    region,
    stableId: hit.stable_id ?? null,
    label: hit.label ?? null,
    heightM: hit.height_m,
    attributes,
  };
}
