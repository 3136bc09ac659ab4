import { beforeEach, expect, it } from "vitest";
import { awayText } from "../../src/app/panel/group-section.ts";
import { checkGroup, GroupState } from "../../src/core/extras/group-state.ts";
import type { GroupEvent } from "../../src/core/extras/group-types.ts";
import type { ClientMessage, ServerMessage } from "../../src/core/wire/messages.ts";

const LIMITS = { groups: "query" } as ServerMessage<"welcome">["limits"];
const JOIN = { type: "join", group: "tour", role: "member", name: "Anna" } as const;
const JOINED = { type: "joined", request: 7, group: "tour", member: 2, role: "member", seat: "secret" } as const;
const ROSTER = {
  type: "roster",
  group: "tour",
  members: [
    { member: 1, role: "guide", present: true },
    { member: 2, name: "Anna", role: "member", present: true, position: [1, 2, 3] },
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
let sent: ClientMessage[];
let state: GroupState;

beforeEach(() => {
  events = [];
  sent = [];
  state = new GroupState({
    send: (message) => sent.push(message),
    report: (event) => events.push(event),
    isOpen: () => true,
  });
});

function joined(): void {
  state.take(JOIN, 7);
  state.onMessage(JOINED);
  state.onMessage(ROSTER);
}

it("says how far somebody stands, and which way", () => {
  expect(awayText([0, 9, 0], [0, 0, -12.4])).toBe("12 m north");
  expect(awayText([0, 0, 0], [5, 0, 5])).toBe("7.1 m south-east");
  expect(awayText([0, 0, 0], [-0.1, 0, -1500])).toBe("1,500 m north");
  expect(awayText([0, 0, 0], [-200, 0, 1])).toBe("200 m west");
  expect(awayText([1, 0, 1], [1.5, 40, 1])).toBe("beside you");
});

it("knows where who has landed stands", () => {
  joined();
  expect(events.at(-1)!.group!.members.map(({ position }) => position)).toEqual([null, [1, 2, 3]]);
});

it("knows who is there over a lost connection, and nothing more of a seat that was given away", () => {
  joined();
  state.connectionLost();
  state.connected(LIMITS);
  expect(sent.at(-1)).toMatchObject({ type: "join", seat: "secret" });
  state.onMessage(JOINED);
  expect(events.at(-1)!.group!.members).toHaveLength(2);
  state.onMessage({ ...JOINED, member: 9, seat: "another" });
  expect(events.at(-1)!.group).toMatchObject({ member: 9, members: [], gathering: null });
});

it("tells where the gathering is, and who came once it is over", () => {
  joined();
  state.onMessage(GATHERING);
  const there = { number: 3, guide: 1, position: [1, 2, 3], radiusM: 40, isOver: false };
  expect(events.at(-1)!.group!.gathering).toMatchObject(there);
  state.onMessage({ type: "gathered", gathering: 3, ready: [1], degraded: [2], missing: [] });
  expect(events.at(-1)!.group!.gathering).toMatchObject({ ...there, isOver: true, ready: [1], degraded: [2] });
});

it("says why there is no seat, and tells of one that is left", () => {
  state.take(JOIN, 7);
  state.refused({ type: "error", code: "group_refused", message: "it has a guide", fatal: false, request: 7 });
  expect(events.at(-1)).toMatchObject({ news: "refused", group: null, refusal: { message: "it has a guide" } });
  joined();
  state.take({ type: "leave" }, 8);
  expect(events.at(-1)).toEqual({ type: "group", news: "left", group: null, refusal: null });
});

it("says again that it has arrived where a cut may have lost it, and not where nobody waits", () => {
  joined();
  state.onMessage(GATHERING);
  state.take({ type: "arrive", gathering: 3, state: "ready" }, 0);
  const arrived = { type: "arrived", gathering: 3, state: "ready" };
  expect(sent.at(-1)).toEqual(arrived);
  sent = [];
  state.connectionLost();
  state.connected(LIMITS);
  state.onMessage(JOINED);
  state.onMessage(GATHERING);
  expect(sent.at(-1)).toEqual(arrived);
  const { left_ms: _, ...over } = GATHERING;
  sent = [];
  state.onMessage(over);
  expect(sent).toEqual([]);
});

it("says nothing of an older gathering, and counts from 1 again in a new seat", () => {
  joined();
  state.onMessage(GATHERING);
  state.onMessage({ ...GATHERING, gathering: 4 });
  sent = [];
  state.take({ type: "arrive", gathering: 3, state: "ready" }, 0);
  expect(sent).toEqual([]);
  state.onMessage({ ...JOINED, seat: "another" });
  state.onMessage({ ...GATHERING, gathering: 4 });
  expect(events.at(-1)).toMatchObject({ news: "called", group: { gathering: { number: 4 } } });
});

it("asks for a gathering as soon as it has its seat again", () => {
  joined();
  state.connectionLost();
  state.take({ type: "gather", position: [1, 2, 3], radiusM: 40 }, 9);
  expect(sent.filter(({ type }) => type === "gather")).toEqual([]);
  state.connected(LIMITS);
  state.onMessage(JOINED);
  expect(sent.at(-1)).toMatchObject({ type: "gather", request: 9, radius_m: 40 });
});

it("refuses names that the protocol does not allow, before anything is sent", () => {
  expect(() => checkGroup({ ...JOIN, group: "a tour" })).toThrow(RangeError);
  expect(() => checkGroup({ ...JOIN, name: "" })).toThrow(RangeError);
  expect(() => checkGroup({ type: "gather", position: [0, 0, 0], radiusM: 0 })).toThrow(RangeError);
  expect(() => checkGroup(JOIN)).not.toThrow();
});
