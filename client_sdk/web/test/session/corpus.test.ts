/** The session corpus (tests/conformance/session): every history, step by step. */

import { readdirSync, readFileSync } from "node:fs";
import { beforeAll, describe, expect, test } from "vitest";
import type { GroupEvent, GroupRole } from "../../src/core/group-types.ts";
import { prepareHash, xxh3 } from "../../src/core/payload/hash.ts";
import type { SessionEvent } from "../../src/core/session/events.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import { ProtocolViolation } from "../../src/core/session/violation.ts";
import type { Budgets, LandOptions, Vec3 } from "../../src/core/types.ts";
import { decodeMessage, encodeMessage } from "../../src/core/wire/codec.ts";

const CORPUS = new URL("../../../../tests/conformance/session/", import.meta.url);
/** Ids of the corpus' scenes: 36 segments at up to two levels. */
const PAYLOADS = Array.from({ length: 72 }, (_, id) => id);

/** What is told of a step, by name; `out` are numbers of messages. */
type Told = Record<string, unknown>;

interface History {
  readonly history: string;
  readonly options: Readonly<Record<string, number | null>>;
}

type Step = { readonly do: readonly [string, ...unknown[]]; readonly told: Told };

beforeAll(prepareHash);

describe.each(readdirSync(CORPUS).filter((name) => name.endsWith(".jsonl")))(
  "the session corpus, step by step: %s",
  (name) => {
    const lines = readFileSync(new URL(name, CORPUS), "utf-8").trimEnd().split("\n");
    const [{ messages }, ...rest] = lines.map((line) => JSON.parse(line)) as [
      { messages: string[] },
      ...(History | Step)[],
    ];
    const starts = rest.flatMap((line, at) => ("history" in line ? [at] : []));

    test(`${starts.length} histories`, () => {
      expect(starts.length).toBeGreaterThan(0);
      for (const [at, start] of starts.entries()) {
        run(rest[start] as History, rest.slice(start + 1, starts[at + 1]) as Step[], messages);
      }
    });
  },
);

function run({ history, options }: History, steps: readonly Step[], messages: readonly string[]): void {
  const { max_triangles: maxTriangles, max_bytes: maxBytes, max_segments: maxSegments } = options;
  const isGiven = ([, bound]: [string, unknown]) => bound !== null;
  const budgets: Budgets = Object.fromEntries(Object.entries({ maxTriangles, maxBytes, maxSegments }).filter(isGiven));
  const releaseFactor = options.release_factor ?? undefined;
  const own = { client: "corpus", budgets, creditBytes: options.credit_bytes!, releaseFactor };
  const session = new ClientSession(own, options.cache_bytes!, xxh3);
  let before: Told = { visible: [], held: [], unfinished: null, aims: [0, 0, 0, 0] };
  for (const [at, { do: command, told: expected }] of steps.entries()) {
    const told: Told = {};
    try {
      const out = perform(session, command, messages);
      if (out.length > 0) told.out = out.map((text) => messages.indexOf(text));
    } catch (error) {
      if (error instanceof ProtocolViolation) told.violation = true;
      else if (error instanceof RangeError) told.refused = true;
      else throw error;
    }
    const events = session.events().flatMap((event) => rowOf(event) ?? []);
    if (events.length > 0) told.events = events;
    const held = PAYLOADS.filter((segment) => session.holdings.has(segment));
    const { landings, hits, prefetchedBytes, usedBytes } = session.aims;
    const aims = [landings, hits, prefetchedBytes, usedBytes];
    const after: Told = { visible: session.visible, held, unfinished: session.unfinished, aims };
    for (const [key, value] of Object.entries(after)) {
      if (JSON.stringify(value) !== JSON.stringify(before[key])) told[key] = value;
    }
    before = after;
    expect(told, `${history}, step ${at}: ${command[0]}`).toEqual(expected);
  }
}

/** Do one step; what is taken to be sent, in base64. */
function perform(session: ClientSession, [name, ...given]: Step["do"], messages: readonly string[]): string[] {
  if (name === "take") return session.dataToSend().map(withoutTimings);
  if (name === "receive") session.receive(new Uint8Array(Buffer.from(messages[given[0] as number]!, "base64")));
  else if (name === "text") session.receive(given[0] as string);
  else if (name === "connected") session.connected(given[0] as boolean);
  else if (name === "lost") session.connectionLost();
  else if (name === "land" || name === "gather") {
    const [position, radiusM] = [numbers(given[0]), number(given[1])];
    const [innerRadiusM, deadlineMs, coarseRadiusM] = given.slice(2).map((value) => value ?? undefined) as number[];
    if (name === "land") session.land(position, radiusM, { innerRadiusM, deadlineMs, coarseRadiusM } as LandOptions);
    else session.group({ type: name, position, radiusM, innerRadiusM, deadlineMs });
  } else if (name === "aim") session.aim(numbers(given[0]), number(given[1]), number(given[2]));
  else if (name === "flush") session.flushAim();
  else if (name === "pick") session.pick(numbers(given[0]), given[1] === null ? undefined : numbers(given[1]));
  else if (name === "bye") session.bye();
  else if (name === "join") {
    const [group, role, own] = given as [string, GroupRole, string | null];
    session.group({ type: "join", group, role, name: own });
  } else if (name === "leave") session.group({ type: "leave" });
  else if (name === "arrived")
    session.group({ type: "arrive", gathering: given[0] as number, state: given[1] as "ready" });
  else throw new Error(`step ${name}`);
  return [];
}

/** JSON has no word for NaN and infinity, a text has. */
function number(value: unknown): number {
  return typeof value === "string" ? Number(value.replace("inf", "Infinity")) : (value as number);
}

function numbers(values: unknown): Vec3 {
  return (values as unknown[]).map(number) as unknown as Vec3;
}

/** A client may ask for the server's times; histories are of one that does not. */
function withoutTimings(data: Uint8Array<ArrayBuffer>): string {
  const message = decodeMessage(data, "client_to_server");
  const told = message.type === "hello" ? encodeMessage({ ...message, timings: undefined }) : data;
  return Buffer.from(told).toString("base64");
}

/** An event as the corpus tells it, in a list; null for those that clients name in their own ways. */
function rowOf(event: SessionEvent): unknown[][] | null {
  if (event.type === "opened") return [["opened", event.changed, event.heldCount]];
  if (event.type === "planned") {
    const { load, keep, nearby } = event.plan;
    return [["planned", event.landing, load.map((facts) => facts.segment), keep, nearby]];
  }
  if (event.type === "arrived") return [["arrived", event.landing, event.entry.facts.segment]];
  if (event.type === "degraded") return [["degraded", event.landing, event.segments]];
  if (event.type === "ready") return [["ready", event.landing, event.visible, event.missing]];
  if (event.type === "superseded") return [["superseded", event.landing, event.by]];
  if (event.type === "prefetched") return [["prefetched", event.segments, event.bytes]];
  if (event.type === "pick-answered") return [["picked", event.request, event.hit?.segment ?? null]];
  if (event.type === "pick-refused") return [["pick refused", event.request, event.code]];
  if (event.type === "refused") return [["refused", event.landing, event.code, event.fatal]];
  if (event.type === "notice") return [["notice", event.kind]];
  if (event.type === "group") return groupRow(event);
  return null;
}

function groupRow({ news, group, refusal }: GroupEvent): unknown[][] | null {
  if (refusal !== null) return [["group refused", refusal.request, refusal.code]];
  if (group === null) return null;
  if (news === "joined") return [["joined", group.name, group.member, group.role]];
  if (news === "roster")
    return [
      [
        "roster",
        group.members.map((one) => [one.member, one.name, one.role, one.isPresent, millimetres(one.position)]),
      ],
    ];
  const { number, guide, isOver, ready, degraded, missing } = group.gathering!;
  return news === "called" ? [["called", number, guide, !isOver]] : [["gathered", number, ready, degraded, missing]];
}

/** Whole numbers are written alike in every language. */
function millimetres(position: readonly number[] | null): number[] | null {
  return position?.map((side) => Math.floor(1000 * side + 0.5)) ?? null;
}
