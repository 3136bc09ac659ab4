/**
 * The seat in a group, over all connections of a session (wire protocol, section 16).
 *
 * PURE.
 */

import type { Gathering, GroupCommand, GroupEvent, GroupFacts } from "../group-types.ts";
import type {
  ClientMessage,
  ErrorMessage,
  GatheredMessage,
  GatheringMessage,
  JoinedMessage,
  JoinMessage,
  RosterMessage,
  ServerLimitsPart,
} from "../wire/messages.generated.ts";

/** A message about groups. */
export type GroupMessage = JoinedMessage | RosterMessage | GatheringMessage | GatheredMessage;

/** What the session's user wants of groups, and what the server said of it. */
export class GroupState {
  readonly #report: (event: GroupEvent) => void;
  /** As it is asked of each connection; null without a wish for a seat. */
  #join: JoinMessage | null = null;
  #group: GroupFacts | null = null;
  /** Requests that may be refused. */
  #gather = -1;

  constructor(report: (event: GroupEvent) => void) {
    this.#report = report;
  }

  /** The message for a command, if any: a `join` is sent with the next welcome, and a seat that is held is left before. */
  take(command: GroupCommand, request: number): ClientMessage | null {
    switch (command.type) {
      case "join": {
        const hadSeat = this.#group !== null;
        this.#group = null;
        this.#join = {
          type: "join",
          request,
          group: command.group,
          role: command.role,
          ...(command.name !== null && { name: command.name }),
        };
        return hadSeat ? { type: "leave" } : null;
      }
      case "leave":
        if (this.#join === null) return null;
        this.#end(null);
        return { type: "leave" };
      case "gather":
        this.#gather = request;
        return { type: "gather", request, position: command.position, radius_m: command.radiusM };
      case "arrive":
        return { type: "arrived", gathering: command.gathering, state: command.state };
    }
  }

  /** The server said welcome: what to ask of it. */
  welcomed(limits: ServerLimitsPart): JoinMessage | null {
    if (this.#join === null) return null;
    if ((limits.groups ?? "none") !== "none") return this.#join;
    this.#end("this service has no groups");
    return null;
  }

  /** What is told of other groups, or crossed a `leave`, is skipped. */
  onMessage(message: GroupMessage): void {
    if (this.#join === null) return;
    if (message.type === "joined") {
      if (message.request !== this.#join.request) return;
      const { group: name, member, role, seat } = message;
      // Taken again by its secret after a lost connection: the same number, the same place at the barrier (16.1).
      this.#join = { ...this.#join, seat };
      const isSame = this.#group?.member === member;
      this.#set({
        members: [],
        gathering: null,
        ...(isSame && this.#group),
        name,
        member,
        role,
      });
    } else if (this.#group !== null) {
      this.#update(this.#group, message);
    }
  }

  /** Take an error; whether it was one of the group's. */
  refused(error: ErrorMessage): boolean {
    if (error.request === undefined) return false;
    if (error.request === this.#gather) {
      this.#gather = -1;
      this.#report({ type: "group", group: this.#group, problem: error.message });
      return true;
    }
    if (error.request !== this.#join?.request) return false;
    this.#end(error.message);
    return true;
  }

  #update(group: GroupFacts, message: Exclude<GroupMessage, JoinedMessage>): void {
    if (message.type === "roster") {
      if (message.group !== group.name) return;
      const members = message.members.map(({ member, name, role, present }) => ({
        member,
        name: name ?? null,
        role,
        isPresent: present,
      }));
      this.#set({ ...group, members });
    } else if (message.type === "gathering") {
      const { gathering: number, guide, position, radius_m: radiusM, left_ms: leftMs } = message;
      const gathering: Gathering = {
        number,
        guide,
        position,
        radiusM,
        isOver: leftMs === undefined,
        ready: [],
        degraded: [],
        missing: [],
      };
      this.#set({ ...group, gathering });
    } else if (message.gathering === group.gathering?.number) {
      const { ready, degraded, missing } = message;
      this.#set({ ...group, gathering: { ...group.gathering, isOver: true, ready, degraded, missing } });
    }
  }

  #set(group: GroupFacts): void {
    this.#group = group;
    this.#report({ type: "group", group, problem: null });
  }

  #end(problem: string | null): void {
    this.#join = null;
    this.#group = null;
    this.#report({ type: "group", group: null, problem });
  }
}
