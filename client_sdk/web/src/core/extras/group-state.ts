/**
 * The seat in a group, over all connections of a session (protocol, section 10).
 *
 * PURE.
 */

import { type ClientMessage, encodeMessage, type ServerMessage } from "../wire/messages.ts";
import type { Gathering, GroupCommand, GroupEvent, GroupFacts, GroupNews, GroupRefusal } from "./group-types.ts";

/** A message about groups. */
export type GroupMessage = ServerMessage<"joined" | "roster" | "gathering" | "gathered">;

/** Gathers that wait for an answer; beyond it the oldest is refused here. */
const MOST_GATHERS = 16;

/** What the state works with. */
export interface GroupStateOptions {
  /** Takes messages to send; called only while the connection is open. */
  readonly send: (message: ClientMessage) => void;
  readonly report: (event: GroupEvent) => void;
  /** Whether the server has said welcome on the present connection. */
  readonly isOpen: () => boolean;
}

/** What the session's user wants of groups, and what the server said of it. */
export class GroupState {
  readonly #send: GroupStateOptions["send"];
  readonly #report: GroupStateOptions["report"];
  readonly #isOpen: GroupStateOptions["isOpen"];
  /** As it is asked of each connection; null without a wish for a seat. */
  #join: ClientMessage<"join"> | null = null;
  #isSeated = false;
  #group: GroupFacts | null = null;
  /** That wait for an answer, by their requests, in the order asked for. */
  readonly #gathers = new Map<number, ClientMessage<"gather">>();
  /** The newest gathering, and what was said of it. */
  #newest = 0;
  #arrived: ClientMessage<"arrived"> | null = null;

  constructor({ send, report, isOpen }: GroupStateOptions) {
    this.#send = send;
    this.#report = report;
    this.#isOpen = isOpen;
  }

  /**
   * Do what a command says.
   *
   * @throws RangeError as {@link checkGroup}; nothing has changed.
   */
  take(command: GroupCommand, request: number): void {
    checkGroup(command);
    if (command.type === "join") {
      // Also where the new seat is refused: the caller has given the old one up.
      this.#leave();
      this.#join = joinMessage(command, request);
      if (this.#isOpen()) this.#send(this.#join);
    } else if (command.type === "leave") {
      const hadWish = this.#join !== null;
      this.#leave();
      if (hadWish) this.#tell("left");
    } else if (command.type === "gather") {
      this.#gather(gatherMessage(command, request));
    } else if (command.gathering === this.#newest) {
      // Of an older one: a newer has come, and nobody waits.
      this.#arrived = arrivedMessage(command);
      if (this.#isSeated) this.#send(this.#arrived);
    }
  }

  /** The server said welcome: the seat is taken again. */
  connected(limits: ServerMessage<"welcome">["limits"]): void {
    const join = this.#join;
    if (join === null) return;
    if (limits.groups !== "none") {
      this.#send(join);
      return;
    }
    this.#reset();
    const message = "no groups are served at this address";
    this.#tell("refused", { request: join.request, code: "group_refused", message });
  }

  /** The seat is taken again on the next connection. */
  connectionLost(): void {
    this.#isSeated = false;
  }

  /** What is told of other groups, or crossed a `leave`, is skipped. */
  onMessage(message: GroupMessage): void {
    const join = this.#join;
    if (join === null) return;
    if (message.type === "joined") {
      if (message.request === join.request) this.#onJoined(message, join);
    } else if (this.#isSeated && this.#group !== null) {
      if (message.type === "roster") this.#onRoster(message, this.#group);
      else if (message.type === "gathering") this.#onGathering(message, this.#group);
      else this.#onGathered(message, this.#group);
    }
  }

  /** Take an error; whether it was one of the group's. */
  refused({ request, code, message }: ServerMessage<"error">): boolean {
    if (request === undefined) return false;
    if (request === this.#join?.request) this.#reset();
    else if (!this.#gathers.delete(request)) return false;
    this.#tell("refused", { request, code, message });
    return true;
  }

  #leave(): void {
    if (this.#join !== null && this.#isOpen()) this.#send({ type: "leave" });
    this.#reset();
  }

  #gather(gather: ClientMessage<"gather">): void {
    this.#gathers.set(gather.request, gather);
    const [oldest] = this.#gathers.keys();
    if (this.#gathers.size > MOST_GATHERS && oldest !== undefined) {
      this.#gathers.delete(oldest);
      const message = `${MOST_GATHERS} gathers wait for an answer already`;
      this.#tell("refused", { request: oldest, code: "too_many", message });
    }
    if (this.#isSeated) this.#send(gather);
  }

  #onJoined({ group: name, member, role, seat }: ServerMessage<"joined">, join: ClientMessage<"join">): void {
    this.#isSeated = true;
    if (seat !== join.seat) {
      // A new seat, perhaps on a new server: its gatherings count from 1 again.
      this.#newest = 0;
      this.#arrived = null;
      this.#group = { name, member, role, members: [], gathering: null };
    }
    this.#join = { ...join, seat };
    this.#tell("joined");
    // What was asked while the connection was away.
    for (const gather of this.#gathers.values()) this.#send(gather);
  }

  #onRoster(message: ServerMessage<"roster">, group: GroupFacts): void {
    if (message.group !== group.name) return;
    const members = message.members.map(({ member, name, role, present, position }) => ({
      member,
      name: name ?? null,
      role,
      isPresent: present,
      position: position ?? null,
    }));
    this.#group = { ...group, members };
    this.#tell("roster");
  }

  #onGathering(message: ServerMessage<"gathering">, group: GroupFacts): void {
    const { gathering: number, guide, position, radius_m: radiusM, left_ms: leftMs } = message;
    if (number === this.#newest) {
      if (this.#arrived !== null && leftMs !== undefined) this.#send(this.#arrived);
      return;
    }
    // The guide's own request is answered by its gathering: requests are answered in order.
    this.#newest = number;
    this.#arrived = null;
    this.#gathers.clear();
    const isOver = leftMs === undefined;
    const gathering: Gathering = { number, guide, position, radiusM, isOver, ready: [], degraded: [], missing: [] };
    this.#group = { ...group, gathering };
    this.#tell("called");
  }

  #onGathered({ gathering: number, ready, degraded, missing }: ServerMessage<"gathered">, group: GroupFacts): void {
    if (number !== this.#newest || group.gathering === null) return;
    this.#group = { ...group, gathering: { ...group.gathering, isOver: true, ready, degraded, missing } };
    this.#tell("gathered");
  }

  #reset(): void {
    this.#join = null;
    this.#isSeated = false;
    this.#group = null;
    this.#gathers.clear();
    this.#newest = 0;
    this.#arrived = null;
  }

  #tell(news: GroupNews, refusal: GroupRefusal | null = null): void {
    this.#report({ type: "group", news, group: this.#group, refusal });
  }
}

/** @throws RangeError for a name or number that the protocol does not allow. */
export function checkGroup(command: GroupCommand): void {
  if (command.type === "join") encodeMessage(joinMessage(command, 0));
  else if (command.type === "gather") encodeMessage(gatherMessage(command, 0));
  else if (command.type === "arrive") encodeMessage(arrivedMessage(command));
}

function joinMessage(
  { group, role, name }: Extract<GroupCommand, { readonly type: "join" }>,
  request: number,
): ClientMessage<"join"> {
  return { type: "join", request, group, role, ...(name !== null && { name }) };
}

function gatherMessage(
  { position, radiusM, innerRadiusM, deadlineMs }: Extract<GroupCommand, { readonly type: "gather" }>,
  request: number,
): ClientMessage<"gather"> {
  return {
    type: "gather",
    request,
    position,
    radius_m: radiusM,
    inner_radius_m: innerRadiusM,
    deadline_ms: deadlineMs,
  };
}

function arrivedMessage({
  gathering,
  state,
}: Extract<GroupCommand, { readonly type: "arrive" }>): ClientMessage<"arrived"> {
  return { type: "arrived", gathering, state };
}
