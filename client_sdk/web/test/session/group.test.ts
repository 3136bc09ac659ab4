import { beforeEach, expect, it } from "vitest";
import { awayText } from "../../src/app/panel/group-section.ts";
import type { GroupEvent } from "../../src/core/group-types.ts";
import { checkGroup } from "../../src/core/session/checks.ts";
import { GroupState } from "../../src/core/session/group-state.ts";
import type { ClientMessage, ServerLimitsPart } from "../../src/core/wire/messages.generated.ts";

const LIMITS = { groups: "query" } as ServerLimitsPart;
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

// When what is said, skipped and said again: the session corpus.
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

it("refuses names that the protocol does not allow, before anything is sent", () => {
  expect(() => checkGroup({ ...JOIN, group: "a tour" })).toThrow(RangeError);
  expect(() => checkGroup({ ...JOIN, name: "" })).toThrow(RangeError);
  expect(() => checkGroup({ type: "gather", position: [0, 0, 0], radiusM: 0 })).toThrow(RangeError);
  expect(() => checkGroup(JOIN)).not.toThrow();
});
