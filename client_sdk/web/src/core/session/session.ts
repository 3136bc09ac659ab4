/**
 * The client's half of the wire protocol as a state machine: WebSocket messages in; events, and messages to send, out.
 *
 * The shell (`core/client`) owns sockets, timers and workers. It calls `connected`, `receive`, `connectionLost` as the
 * connection lives and dies, and `land`, `aim`, `pick` for its user; after each of them it drains `events()` and
 * `dataToSend()`.
 *
 * Section numbers in comments are those of `spec/wire-protocol.md`.
 *
 * PURE: no I/O, no clock, no timer.
 */

import type { GroupCommand } from "../group-types.ts";
import type { LandOptions, Vec3 } from "../types.ts";
import { decodeMessage, encodeMessage } from "../wire/codec.ts";
import { DecodeError } from "../wire/errors.ts";
import { decodeFrame, isPayload } from "../wire/frames.ts";
import type { ClientMessage, ErrorMessage, ServerMessage, WelcomeMessage } from "../wire/messages.generated.ts";
import { PROTOCOL } from "../wire/messages.generated.ts";
import type { AimCounts } from "./aim-counts.ts";
import { AimState } from "./aim-state.ts";
import { SegmentCache } from "./cache.ts";
import { check, checkAim, checkGroup, checkLand, checkPick } from "./checks.ts";
import type { SessionEvent } from "./events.ts";
import { GroupState } from "./group-state.ts";
import { Holdings } from "./holdings.ts";
import { LandingState } from "./landing-state.ts";
import { HeldOffer } from "./offer.ts";
import { helloMessage, type SessionOptions } from "./options.ts";
import { PickState } from "./pick-state.ts";
import { Transfers } from "./transfers.ts";
import { ProtocolViolation } from "./violation.ts";

/** The state machine. It outlives connections. */
export class ClientSession {
  readonly options: SessionOptions;
  /** Scene version of the newest connection. */
  version: string | null = null;
  /** Segments of that version: ids from here on are those of their coarser levels (6.1). */
  segmentCount = Number.POSITIVE_INFINITY;
  readonly holdings: Holdings;
  #events: SessionEvent[] = [];
  #outbox: ClientMessage[] = [];
  readonly #transfers: Transfers;
  readonly #aim = new AimState();
  readonly #offer = new HeldOffer();
  readonly #picks: PickState;
  readonly #group: GroupState;
  #open = false;
  #greeting = false;
  #generation = 0;
  /** Of the newest connection. */
  #maxRadiusM = Number.POSITIVE_INFINITY;
  #landings = 0;
  #requests = 0;
  /** The landing whose `land` is still in the outbox. */
  #unsent: LandingState | null = null;
  /** The landing that waits for the next welcome. */
  #queued: LandingState | null = null;
  #creditStep = 1;
  #takenBytes = 0;

  /**
   * @param cacheBytes - bound on the payload bytes kept beside what is pinned.
   * @param xxh3 - XXH3-64 of a payload.
   * @throws RangeError on options that the protocol does not allow.
   */
  constructor(options: SessionOptions, cacheBytes: number, xxh3: (bytes: Uint8Array) => bigint) {
    if (!(options.creditBytes >= 1)) {
      throw new RangeError(`credit is ${options.creditBytes} bytes, expected 1 or more`);
    }
    check(helloMessage(options, []));
    this.options = options;
    this.holdings = new Holdings(new SegmentCache(cacheBytes));
    const report = (event: SessionEvent) => void this.#events.push(event);
    const send = (message: ClientMessage) => void this.#outbox.push(message);
    this.#transfers = new Transfers({
      holdings: this.holdings,
      maxGpuBytes: options.budgets.maxGpuBytes,
      xxh3,
      send,
      report,
    });
    this.#picks = new PickState(report);
    this.#group = new GroupState({ send, report, isOpen: () => this.#open });
  }

  /** Whether the server has said welcome on the present connection. */
  get open(): boolean {
    return this.#open;
  }

  /** Whether an aim waits for {@link flushAim}. */
  get hasAim(): boolean {
    return this.#aim.waits && this.#open;
  }

  /** Ids that the last ready landing shows, ascending. */
  get visible(): readonly number[] {
    return this.#transfers.visible;
  }

  /** Chunk bytes taken, over all connections. */
  get payloadBytes(): number {
    return this.#transfers.payloadBytes;
  }

  /** Those of them that belong to segments which were held already; 0 with a right server. */
  get repeatedBytes(): number {
    return this.#transfers.repeatedBytes;
  }

  /** What aims have brought, and what of it was used. */
  get aims(): AimCounts {
    return this.#transfers.aims;
  }

  /** Number of the newest landing that is not ready. */
  get unfinished(): number | null {
    return (this.#queued ?? this.#transfers.unfinished)?.number ?? null;
  }

  /** Whether the server owes an answer: to a landing or a pick. */
  get awaitsAnswer(): boolean {
    return this.unfinished !== null || this.#picks.count > 0;
  }

  /** Picks that wait for an answer. */
  get openPicks(): number {
    return this.#picks.count;
  }

  /** Segments that are partly here. */
  get partialCount(): number {
    return this.#transfers.partialCount;
  }

  // ---- output

  /** What has happened since the last call, once. */
  events(): SessionEvent[] {
    const events = this.#events;
    this.#events = [];
    return events;
  }

  /** The WebSocket messages to send, once, in order. */
  dataToSend(): Uint8Array<ArrayBuffer>[] {
    const messages = this.#outbox;
    this.#outbox = [];
    this.#unsent = null;
    return messages.map((message) => encodeMessage(message));
  }

  // ---- connection

  /**
   * Open a connection: the first message is `hello` with what is held.
   *
   * @param offerHeld - false after a server found the offer too large: it is made after its welcome, which says how
   *   large it may be.
   */
  connected(offerHeld = true): void {
    this.#open = false;
    this.#greeting = true;
    this.#outbox = [helloMessage(this.options, this.#offer.first(this.holdings.offer(), offerHeld))];
  }

  /**
   * Note that the connection is gone.
   *
   * The newest landing that is not ready waits for the next connection, and so do the newest aim after it, picks and the
   * seat in a group. Parts of segments are forgotten (10.2).
   */
  connectionLost(): void {
    this.#open = false;
    this.#greeting = false;
    this.#outbox = [];
    this.#unsent = null;
    // Credit belongs to the connection (8).
    this.#takenBytes = 0;
    this.#aim.connectionLost(this.#transfers.aimDone);
    this.#queue(this.#transfers.connectionLost());
    this.#group.connectionLost();
  }

  /**
   * Take one whole WebSocket message.
   *
   * @throws ProtocolViolation where the server sent what the protocol does not allow; the connection must be closed
   *   with 4400.
   */
  receive(data: Uint8Array<ArrayBuffer> | string): void {
    try {
      if (isPayload(data)) {
        const frame = decodeFrame(data as Uint8Array<ArrayBuffer>);
        if ("unknownKind" in frame) return;
        this.#transfers.onFrame(frame);
        this.#grant(frame.chunk.byteLength);
        return;
      }
      const message = decodeMessage(data, "server_to_client");
      if (message.type !== "unknown") this.#onMessage(message);
    } catch (error) {
      if (error instanceof DecodeError) throw new ProtocolViolation(error.message, { cause: error });
      throw error;
    }
  }

  // ---- commands

  /**
   * Ask for a landing; it supersedes every one before that is not ready.
   *
   * @returns its number in the events. It stays the same when a reconnect asks again under a new generation.
   * @throws RangeError on a number that the protocol does not allow; nothing has changed.
   */
  land(position: Vec3, radiusM: number, options: LandOptions = {}): number {
    checkLand(position, radiusM, options);
    this.#landings += 1;
    const landing = new LandingState(this.#landings, position, radiusM, options);
    this.#aim.clear();
    if (this.#open) this.#sendLanding(landing);
    else this.#queue(landing);
    return landing.number;
  }

  /**
   * Note where the user points; only the newest is kept until {@link flushAim}.
   *
   * @throws RangeError on a number that the protocol does not allow; nothing has changed.
   */
  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    checkAim(position, radiusM, coarseRadiusM);
    this.#aim.note(position, radiusM, coarseRadiusM);
  }

  /** Send the newest aim, if there is one and the connection is open. */
  flushAim(): void {
    if (!this.hasAim) return;
    this.#sendEvictions();
    this.#generation += 1;
    const message = this.#aim.take(this.#generation, this.#maxRadiusM);
    if (message !== null) this.#outbox.push(message);
  }

  /**
   * Ask what lies along a ray; returns the request's number in the events.
   *
   * @throws RangeError on a number that the protocol does not allow; nothing has changed.
   */
  pick(origin: Vec3, direction?: Vec3): number {
    checkPick(origin, direction);
    this.#requests += 1;
    const pick = this.#picks.ask(this.#requests, origin, direction);
    if (this.#open) this.#outbox.push(pick);
    return this.#requests;
  }

  /** Forget a pick: its answer is skipped, a reconnect does not ask again. */
  dropPick(request: number): void {
    this.#picks.drop(request);
  }

  /**
   * Do something in a group. Without a connection a `join` and a `gather` wait for the next welcome.
   *
   * @throws RangeError on a value that the protocol does not allow; nothing has changed.
   */
  group(command: GroupCommand): void {
    checkGroup(command);
    if (command.type === "join" || command.type === "gather") this.#requests += 1;
    this.#group.take(command, this.#requests);
  }

  /** Say `bye`, where there is a connection: the server then closes at once (5.6). */
  bye(): void {
    if (this.#open) this.#outbox.push({ type: "bye" });
  }

  // ---- messages

  #onMessage(message: ServerMessage): void {
    if (message.type === "welcome") this.#onWelcome(message);
    else if (message.type === "error") this.#onError(message);
    else if (this.#open) this.#onAnswer(message);
    else throw new ProtocolViolation(`got ${message.type} first, expected welcome or error`);
  }

  /** Take a message that only an open session has. */
  #onAnswer(message: Exclude<ServerMessage, WelcomeMessage | ErrorMessage>): void {
    const transfers = this.#transfers;
    if (message.type === "plan") transfers.onPlan(message);
    else if (message.type === "ready") transfers.onReady(message);
    else if (message.type === "degraded") transfers.onDegraded(message);
    else if (message.type === "superseded") transfers.onSuperseded(message);
    else if (message.type === "prefetch") transfers.onPrefetch(message);
    else if (message.type === "picked") this.#picks.answered(message);
    else if (message.type === "held_checked") this.#onDropped(message.dropped);
    else if (message.type === "notice") {
      const { kind, version = null, reconnect_after_ms: reconnectAfterMs = null } = message;
      this.#events.push({ type: "notice", kind, version, reconnectAfterMs });
    } else this.#group.onMessage(message);
  }

  #onWelcome(welcome: WelcomeMessage): void {
    if (this.#open || !this.#greeting) throw new ProtocolViolation("got a second welcome, expected one");
    if (welcome.protocol[0] !== PROTOCOL[0]) {
      throw new ProtocolViolation(`got protocol ${welcome.protocol.join(".")}, expected ${PROTOCOL[0]}.x`);
    }
    this.#open = true;
    this.#greeting = false;
    const { scene, limits, session } = welcome;
    const changed = this.version !== null && this.version !== scene.version;
    this.version = scene.version;
    this.segmentCount = scene.segment_count;
    this.#maxRadiusM = limits.max_radius_m;
    // Visible ids meant segments of the version before (5.4).
    if (changed) this.#transfers.hideAll();
    // Granted in halves: the server never runs dry while a grant is on its way (8).
    this.#creditStep = Math.max(1, Math.floor(Math.min(this.options.creditBytes, limits.max_credit_bytes) / 2));
    this.#events.push({ type: "opened", scene, limits, session, heldCount: welcome.held_count, changed });
    // In this order (5.3): what is held is offered whole before the landing, whose plan counts on it; what a connection left
    // unanswered is asked again.
    this.#onDropped(welcome.dropped);
    const { messages, unsendable } = this.#offer.remaining(welcome);
    this.#outbox.push(...messages);
    // A server that takes no table cannot be told: what it does not know of is not held (10.2).
    this.#onDropped(unsendable.map((row) => row.segment));
    this.#outbox.push(...this.#picks.waiting());
    this.#group.connected(limits);
    if (this.#queued !== null) {
      const landing = this.#queued;
      this.#queued = null;
      this.#sendLanding(landing);
    }
  }

  /** Free what the server does not count as held. */
  #onDropped(segments: readonly number[]): void {
    if (segments.length === 0) return;
    this.holdings.forget(segments);
    this.#events.push({ type: "dropped", segments });
  }

  #onError(error: ErrorMessage): void {
    const isOfPick = this.#picks.refused(error);
    if ((isOfPick || this.#group.refused(error)) && !error.fatal) return;
    this.#aim.refused(error.generation);
    const { code, message, fatal } = error;
    const refused = fatal ? null : this.#transfers.refused(error.generation);
    this.#events.push({ type: "refused", code, message, fatal, landing: refused?.number ?? null });
  }

  // ---- state

  /** Keep the newest landing for the next connection; what waited before is superseded. */
  #queue(landing: LandingState | null): void {
    if (landing === null) return;
    if (this.#queued !== null) {
      this.#events.push({ type: "superseded", landing: this.#queued.number, by: landing.number });
    }
    this.#queued = landing;
  }

  #sendLanding(landing: LandingState): void {
    this.#withdrawUnsent(landing);
    this.#sendEvictions();
    this.#generation += 1;
    landing.generation = this.#generation;
    this.#transfers.ask(landing);
    this.#outbox.push(landing.message(this.#generation, this.#maxRadiusM));
    this.#unsent = landing;
  }

  /** Replace a landing that never left: however often the user lands, one `land` waits to be sent. */
  #withdrawUnsent(newer: LandingState): void {
    const unsent = this.#unsent;
    if (unsent === null) return;
    this.#outbox = this.#outbox.filter((message) => message.type !== "land");
    if (!this.#transfers.withdraw(unsent)) return;
    this.#events.push({ type: "superseded", landing: unsent.number, by: newer.number });
  }

  #sendEvictions(): void {
    // What may not be told now (6.7, rule 2) is told before the next land or aim.
    if (!this.#transfers.awaitsPlan) this.#outbox.push(...this.holdings.evictions(this.#transfers.openPlan));
  }

  #grant(takenBytes: number): void {
    this.#takenBytes += takenBytes;
    if (this.#takenBytes < this.#creditStep) return;
    const granted = this.#takenBytes;
    this.#takenBytes = 0;
    // One that was not sent yet grows: what waits must not grow with what comes.
    const at = this.#outbox.findIndex((message) => message.type === "credit");
    const waiting = this.#outbox[at];
    if (waiting?.type !== "credit") this.#outbox.push({ type: "credit", bytes: granted });
    else this.#outbox[at] = { type: "credit", bytes: waiting.bytes + granted };
  }
}
