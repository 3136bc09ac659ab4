/**
 * The server's half of the wire protocol, as short as its rules allow: what the client's state machine is tested
 * against. Section numbers are those of `spec/wire-protocol.md`.
 */

import { decodeMessage, encodeMessage } from "../../src/core/wire/codec.ts";
import { encodeFrame } from "../../src/core/wire/frames.ts";
import {
  type ClientMessage,
  type LandMessage,
  PROTOCOL,
  type ServerMessage,
} from "../../src/core/wire/messages.generated.ts";
import { distance, type ToyScene } from "./toy-scene.ts";

type Data = Uint8Array<ArrayBuffer>;

export interface ModelOptions {
  readonly maxHeldSegments?: number;
  readonly maxPicks?: number;
  readonly maxChunk?: number;
  readonly random?: () => number;
}

/** A generation on its way: a landing, or what an aim brings. */
interface Sending {
  readonly generation: number;
  /** Null for an aim. */
  readonly land: LandMessage | null;
  /** Distance and id of all that is wanted, in order. */
  readonly order: readonly number[];
  readonly inner: readonly number[];
  /** What is still to be sent, in order. */
  queue: number[];
  readonly load: ReadonlySet<number>;
  readonly rejected: Set<number>;
  readonly missing: Set<number>;
  delivered: number;
  payloadBytes: number;
  readySent: boolean;
  degradedSent: boolean;
}

/** One connection. Throws on what a client must not do. */
export class ModelServer {
  readonly held = new Map<number, bigint>();
  credit = 0;
  /** Chunk bytes sent. */
  chunkBytes = 0;
  /** Everything that the client said, in order. */
  readonly heard: ClientMessage[] = [];
  deadlinePassed = false;
  /** Whether a landing waits for its plan until `planLate` (6.3). */
  plansLate = false;
  #unplanned: LandMessage | null = null;
  /** Ids that cannot be read whole. */
  readonly unreadable = new Set<number>();
  readonly #scene: ToyScene;
  readonly #options: Required<ModelOptions>;
  #out: ServerMessage[] = [];
  #open = false;
  #moved = false;
  #budgets: { max_triangles?: number | undefined; max_bytes?: number | undefined; max_segments?: number | undefined } =
    {};
  #releaseFactor = 1;
  #generation = -1;
  #landing: Sending | null = null;
  #prefetch: Sending | null = null;
  #waitingAim: (ClientMessage & { type: "aim" }) | null = null;
  #partials = new Map<number, number>();

  constructor(scene: ToyScene, options: ModelOptions = {}) {
    this.#scene = scene;
    this.#options = {
      maxHeldSegments: 1000,
      maxPicks: 8,
      maxChunk: 131_048,
      random: () => 0.999,
      ...options,
    };
  }

  say(message: ServerMessage): void {
    this.#out.push(message);
  }

  receive(data: Data): void {
    const message = decodeMessage(data, "client_to_server");
    if (message.type === "unknown") throw new Error(`the client said ${message.name}`);
    this.heard.push(message);
    if (message.type === "hello") this.#hello(message);
    else if (!this.#open) throw new Error(`got ${message.type} before hello`);
    else if (message.type === "held") this.#moreHeld(message.segments);
    else if (message.type === "credit") this.credit += message.bytes;
    else if (message.type === "evict") this.#evict(message.segments);
    else if (message.type === "reject") this.#reject(message.segment);
    else if (message.type === "pick") this.#pick(message.request);
    else if (message.type === "land") this.#land(message);
    else if (message.type === "aim") this.#aim(message);
  }

  /** The next WebSocket message; null where nothing can be sent now. */
  next(): Data | null {
    const message = this.#out.shift();
    if (message !== undefined) return encodeMessage(message);
    for (const sending of [this.#landing, this.#prefetch]) {
      if (sending === null || sending.readySent) continue;
      this.#degrade(sending);
      const degraded = this.#out.shift();
      if (degraded !== undefined) return encodeMessage(degraded);
      const chunk = this.#chunk(sending);
      if (chunk !== null) return chunk;
      this.#settle(sending);
      const answer = this.#out.shift();
      if (answer !== undefined) return encodeMessage(answer);
      // An aim never disturbs a landing (7, rule 2).
      if (!sending.readySent) return null;
    }
    return null;
  }

  // ---- private

  #hello(hello: ClientMessage & { type: "hello" }): void {
    if (this.#open) throw new Error("a second hello");
    this.#open = true;
    this.credit = hello.credit_bytes;
    this.#budgets = hello.budgets;
    this.#releaseFactor = hello.release_factor ?? 1.25;
    const dropped = this.#accept(hello.held ?? []);
    this.say({
      type: "welcome",
      protocol: PROTOCOL,
      server: "model",
      session: "s",
      scene: { id: "toy", version: this.#scene.version, name: "toy", segment_count: this.#scene.facts.length },
      limits: {
        max_radius_m: 500,
        max_message_bytes: 1 << 20,
        max_messages_per_s: 60,
        max_held_segments: this.#options.maxHeldSegments,
        max_plan_segments: 16384,
        max_credit_bytes: 1 << 26,
        idle_timeout_s: 60,
      },
      release_factor: this.#releaseFactor,
      dropped,
      held_count: this.held.size,
    });
  }

  #accept(rows: readonly { segment: number; xxh3: bigint }[]): number[] {
    const dropped: number[] = [];
    for (const { segment, xxh3 } of rows) {
      if (this.#scene.facts[segment]?.xxh3 === xxh3) this.held.set(segment, xxh3);
      else dropped.push(segment);
    }
    return dropped;
  }

  #moreHeld(rows: readonly { segment: number; xxh3: bigint }[]): void {
    if (this.#moved) throw new Error("held after an aim or land");
    if (rows.length > this.#options.maxHeldSegments) throw new Error(`held with ${rows.length} rows`);
    this.say({ type: "held_checked", dropped: this.#accept(rows), held_count: this.held.size });
  }

  #evict(segments: readonly number[]): void {
    const landing = this.#landing;
    for (const segment of segments) {
      if (landing !== null && !landing.readySent && landing.order.includes(segment)) {
        throw new Error(`evicts ${segment} of a plan that is not ready (6.7, rule 2)`);
      }
      this.held.delete(segment);
    }
  }

  #reject(segment: number): void {
    this.held.delete(segment);
    const sending = this.#landing?.order.includes(segment) ? this.#landing : this.#prefetch;
    if (sending === null || !sending.order.includes(segment)) return;
    if (sending.land === null && !sending.load.has(segment)) return;
    if (sending.rejected.has(segment)) {
      if (sending.land !== null) {
        sending.missing.add(segment);
        sending.readySent = false;
      }
      return;
    }
    sending.rejected.add(segment);
    sending.readySent = false;
    const rank = (id: number) => (this.#partials.has(id) ? -1 : sending.order.indexOf(id));
    sending.queue = [...sending.queue, segment].sort((a, b) => rank(a) - rank(b));
  }

  #pick(request: number): void {
    if (this.#options.maxPicks === 0) {
      this.say({ type: "error", code: "too_many", message: "picks", fatal: false, request });
      return;
    }
    const hit = { position: [0, 0, 0], normal: [0, 1, 0], segment: 3, region: 1, height_m: 9, attributes: {} } as const;
    this.say({ type: "picked", request, hit });
  }

  #land(land: LandMessage): void {
    this.#expectNewer(land.generation);
    if (land.radius_m > 500) {
      const { generation } = land;
      this.say({ type: "error", code: "radius_too_large", message: "too large", fatal: false, generation });
      return;
    }
    this.#supersede(land.generation);
    if (this.plansLate) this.#unplanned = land;
    else this.#plan(land);
  }

  /** Plan what waited for it. */
  planLate(): void {
    const land = this.#unplanned;
    this.#unplanned = null;
    if (land !== null) this.#plan(land);
  }

  #plan(land: LandMessage): void {
    this.deadlinePassed = false;
    const order = this.#ordered(land.position, land.radius_m);
    const fitting = this.#within(order);
    const isNear = (segment: number) => distance(land.position, this.#scene.facts[segment]!.bounds) <= land.radius_m;
    const target = fitting.wanted.filter(isNear);
    const load = target.filter((segment) => !this.held.has(segment));
    const innerRadius = land.inner_radius_m ?? -1;
    const inner = target.filter((id) => distance(land.position, this.#scene.facts[id]!.bounds) <= innerRadius);
    this.#prefetch = null;
    this.#landing = this.#begin(land.generation, land, target, load, inner);
    const omitted = order.filter(isNear).slice(target.length);
    this.say({
      type: "plan",
      generation: land.generation,
      position: land.position,
      radius_m: land.radius_m,
      release_radius_m: land.radius_m * this.#releaseFactor,
      effective_radius_m:
        omitted[0] === undefined ? land.radius_m : distance(land.position, this.#scene.facts[omitted[0]]!.bounds),
      inner_count: inner.length,
      load: load.map((segment) => this.#scene.facts[segment]!),
      keep: target.filter((segment) => this.held.has(segment)).sort((a, b) => a - b),
      nearby: fitting.wanted.filter((segment) => !isNear(segment)).sort((a, b) => a - b),
      load_bytes: this.#scene.bytesOf(load),
      load_triangles: 10 * load.length,
      total_bytes: this.#scene.bytesOf(target),
      total_triangles: 10 * target.length,
      omitted_segments: omitted.length,
      omitted_by: omitted.length > 0 ? fitting.omittedBy : undefined,
    });
  }

  #aim(aim: ClientMessage & { type: "aim" }): void {
    this.#expectNewer(aim.generation);
    if (this.#waitingAim !== null) {
      this.say({ type: "superseded", generation: this.#waitingAim.generation, by: aim.generation, unsent_bytes: 0 });
    }
    this.#waitingAim = aim;
    if (this.#landing !== null && !this.#landing.readySent) return;
    this.#tellSuperseded(this.#prefetch, aim.generation);
    this.#startAim();
  }

  #startAim(): void {
    const aim = this.#waitingAim;
    if (aim === null) return;
    this.#waitingAim = null;
    const { wanted } = this.#within(this.#ordered(aim.position, aim.radius_m));
    const load = wanted.filter((segment) => !this.held.has(segment));
    this.#prefetch = this.#begin(aim.generation, null, wanted, load, []);
    const segments = load.map((segment) => this.#scene.facts[segment]!);
    this.say({ type: "prefetch", generation: aim.generation, segments, bytes: this.#scene.bytesOf(load) });
  }

  #begin(
    generation: number,
    land: LandMessage | null,
    order: readonly number[],
    load: readonly number[],
    inner: readonly number[],
  ): Sending {
    for (const segment of [...this.#partials.keys()]) if (!load.includes(segment)) this.#partials.delete(segment);
    return {
      generation,
      land,
      order,
      inner,
      queue: [...load],
      load: new Set(load),
      rejected: new Set(),
      missing: new Set(),
      delivered: 0,
      payloadBytes: 0,
      readySent: false,
      degradedSent: false,
    };
  }

  #supersede(by: number): void {
    if (this.#unplanned !== null) {
      this.say({ type: "superseded", generation: this.#unplanned.generation, by, unsent_bytes: 0 });
      this.#unplanned = null;
    }
    if (this.#waitingAim !== null) {
      this.say({ type: "superseded", generation: this.#waitingAim.generation, by, unsent_bytes: 0 });
      this.#waitingAim = null;
    }
    this.#tellSuperseded(this.#prefetch, by);
    this.#tellSuperseded(this.#landing, by);
  }

  #tellSuperseded(sending: Sending | null, by: number): void {
    if (sending === null || sending.readySent) return;
    const { generation, queue } = sending;
    this.say({ type: "superseded", generation, by, unsent_bytes: this.#scene.bytesOf(queue) });
  }

  /** Candidates in order (6.1). */
  #ordered(centre: readonly [number, number, number], radiusM: number): number[] {
    const far = (segment: number) => distance(centre, this.#scene.facts[segment]!.bounds);
    return this.#scene.facts
      .map((row) => row.segment)
      .filter((id) => far(id) <= (this.held.has(id) ? radiusM * this.#releaseFactor : radiusM))
      .sort((a, b) => far(a) - far(b) || a - b);
  }

  /** The strict prefix that the budgets allow (6.2). */
  #within(order: readonly number[]) {
    const { max_segments = 16384, max_triangles = Infinity, max_bytes = Infinity } = this.#budgets;
    const wanted: number[] = [];
    for (const segment of order) {
      const next = [...wanted, segment];
      if (next.length > max_segments) return { wanted, omittedBy: "max_segments" as const };
      if (10 * next.length > max_triangles) return { wanted, omittedBy: "max_triangles" as const };
      if (this.#scene.bytesOf(next) > max_bytes) return { wanted, omittedBy: "max_bytes" as const };
      wanted.push(segment);
    }
    return { wanted, omittedBy: undefined };
  }

  #chunk(sending: Sending): Data | null {
    while (sending.queue.length > 0 && this.unreadable.has(sending.queue[0]!)) {
      sending.missing.add(sending.queue.shift()!);
    }
    const segment = sending.queue[0];
    if (segment === undefined || this.credit < 1) return null;
    const payload = this.#scene.payloads[segment]!;
    const offset = this.#partials.get(segment) ?? 0;
    const random = 1 + Math.floor(this.#options.random() * this.#options.maxChunk);
    const length = Math.min(random, this.credit, payload.length - offset);
    const chunk = payload.subarray(offset, offset + length);
    this.credit -= length;
    this.chunkBytes += length;
    sending.payloadBytes += length;
    this.#partials.set(segment, offset + length);
    if (offset + length === payload.length) {
      this.#partials.delete(segment);
      sending.queue.shift();
      sending.delivered += 1;
      this.held.set(segment, this.#scene.facts[segment]!.xxh3);
    }
    return encodeFrame({ generation: sending.generation, segment, offset, total: payload.length, chunk });
  }

  /** Say `degraded` where the deadline has passed and the inner set is whole. */
  #degrade(sending: Sending): void {
    const innerIsHeld = sending.inner.length > 0 && sending.inner.every((segment) => this.held.has(segment));
    if (this.deadlinePassed && !sending.degradedSent && innerIsHeld) {
      sending.degradedSent = true;
      this.say({ type: "degraded", generation: sending.generation, segments: sending.inner });
    }
  }

  /** Say `ready` where everything is sent. */
  #settle(sending: Sending): void {
    const { generation } = sending;
    if (sending.queue.length > 0) return;
    sending.readySent = true;
    if (sending.land !== null) {
      const missing = [...sending.missing].sort((a, b) => a - b);
      const { delivered, payloadBytes } = sending;
      this.say({ type: "ready", generation, delivered, payload_bytes: payloadBytes, missing });
    }
    if (sending === this.#landing) this.#startAim();
  }

  #expectNewer(generation: number): void {
    if (generation <= this.#generation) throw new Error(`generation ${generation} after ${this.#generation}`);
    this.#generation = generation;
    this.#moved = true;
  }
}
