import { beforeEach, expect, it } from "vitest";
import type { GroupEvent } from "../../src/core/group-types.ts";
import { checkGroup } from "../../src/core/session/checks.ts";
import { GroupState } from "../../src/core/session/group-state.ts";
import type { ServerLimitsPart } from "../../src/core/wire/messages.generated.ts";

const LIMITS = { groups: "query" } as ServerLimitsPart;
const JOIN = { type: "join", group: "tour", role: "member", name: "Anna" } as const;
const JOINED = { type: "joined", request: 7, group: "tour", member: 2, role: "member", seat: "secret" } as const;
const ROSTER = {
  type: "roster",
  group: "tour",
  members: [
    { member: 1, role: "guide", present: true },
    { member: 2, name: "Anna", role: "member", present: true },
  ],
} as const;
const GATHERING = {
  type: "gathering",
  gathering: 3,
  guide: 1,
  position: [1, 2, 3],
  radius_m: 40,
  left_ms: 900,
} as const;

let events: GroupEvent[];
let state: GroupState;

beforeEach(() => {
  events = [];
  state = new GroupState((event) => events.push(event));
});

function joined(): void {
  state.take(JOIN, 7);
  state.welcomed(LIMITS);
  state.onMessage(JOINED);
  state.onMessage(ROSTER);
}

it("asks for the seat with each welcome, and takes it again by its secret", () => {
  expect(state.welcomed(LIMITS)).toBeNull();
  expect(state.take(JOIN, 7)).toBeNull();
  expect(state.welcomed(LIMITS)).toEqual({ type: "join", request: 7, group: "tour", role: "member", name: "Anna" });
  state.onMessage(JOINED);
  state.onMessage(ROSTER);
  expect(state.welcomed(LIMITS)).toMatchObject({ type: "join", seat: "secret" });
  // The seat is the same: who is there stays known until the next roster.
  state.onMessage(JOINED);
  expect(events.at(-1)!.group!.members).toHaveLength(2);
  // Another seat, after a server that forgot: nothing of the one before holds.
  state.onMessage({ ...JOINED, member: 9 });
  expect(events.at(-1)!.group).toMatchObject({ member: 9, members: [], gathering: null });
});

it("tells of the gathering, and of who came once it is over", () => {
  joined();
  state.onMessage(GATHERING);
  expect(events.at(-1)!.group!.gathering).toMatchObject({ number: 3, guide: 1, radiusM: 40, isOver: false });
  // Of a gathering that a newer one has ended.
  state.onMessage({ type: "gathered", gathering: 2, ready: [2], degraded: [], missing: [1] });
  expect(events.at(-1)!.group!.gathering!.isOver).toBe(false);
  state.onMessage({ type: "gathered", gathering: 3, ready: [1], degraded: [2], missing: [] });
  expect(events.at(-1)!.group!.gathering).toMatchObject({ isOver: true, ready: [1], degraded: [2] });
  // Who comes late: nobody waits.
  state.onMessage({ type: "gathering", gathering: 4, guide: 1, position: [1, 2, 3], radius_m: 40 });
  expect(events.at(-1)!.group!.gathering).toMatchObject({ number: 4, isOver: true });
});

it("has no seat after a refusal, on a service without groups, and after leaving", () => {
  const refusal = { type: "error", code: "group_refused", message: "the group has a guide", fatal: false } as const;
  state.take(JOIN, 7);
  expect(state.refused({ ...refusal, request: 6 })).toBe(false);
  expect(state.refused({ ...refusal, request: 7 })).toBe(true);
  expect(events.at(-1)).toEqual({ type: "group", group: null, problem: "the group has a guide" });
  expect(state.welcomed(LIMITS)).toBeNull();

  state.take(JOIN, 8);
  expect(state.welcomed({} as ServerLimitsPart)).toBeNull();
  expect(events.at(-1)!.problem).toContain("no groups");

  joined();
  expect(state.take({ type: "leave" }, 9)).toEqual({ type: "leave" });
  expect(events.at(-1)).toEqual({ type: "group", group: null, problem: null });
  // It crossed.
  state.onMessage(ROSTER);
  expect(events.at(-1)!.group).toBeNull();
  expect(state.take({ type: "leave" }, 10)).toBeNull();
});

it("keeps the seat where a gather is refused, and leaves one before it takes another", () => {
  joined();
  expect(state.take({ type: "gather", position: [0, 0, 0], radiusM: 5 }, 11)).toMatchObject({ radius_m: 5 });
  const refusal = { type: "error", code: "group_refused", message: "only the guide may", fatal: false } as const;
  expect(state.refused({ ...refusal, request: 11 })).toBe(true);
  expect(events.at(-1)).toMatchObject({ group: { name: "tour" }, problem: "only the guide may" });
  expect(state.take({ ...JOIN, group: "other" }, 12)).toEqual({ type: "leave" });
  expect(state.welcomed(LIMITS)).toMatchObject({ group: "other", request: 12 });
});

it("refuses names that the protocol does not allow, before anything is sent", () => {
  expect(() => checkGroup({ ...JOIN, group: "a tour" })).toThrow(RangeError);
  expect(() => checkGroup({ ...JOIN, name: "" })).toThrow(RangeError);
  expect(() => checkGroup({ type: "gather", position: [0, 0, 0], radiusM: 0 })).toThrow(RangeError);
  expect(() => checkGroup(JOIN)).not.toThrow();
});
