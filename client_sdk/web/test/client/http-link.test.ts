/** A session over HTTP whose pack fails, served by Node. */

import { readFileSync } from "node:fs";
import { createServer, type IncomingMessage, type Server, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { HttpLink } from "../../src/core/client/http-link.ts";
import type { SessionEvent } from "../../src/core/session/events.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import type { LinkState } from "../../src/core/types.ts";
import { encoded, planOf } from "./answering-server.ts";
import { MIDDLE, TOY, toyWithin } from "./toy-scene.ts";

const MANIFEST = readFileSync(new URL("../../../../tests/conformance/scene/tiny/scene.json", import.meta.url));
const RADIUS_M = 3;
const WANTED = toyWithin(MIDDLE, RADIUS_M);
/** So far apart in the pack that each is a range of its own. */
const STRIDE_BYTES = 100_000;
const FAILING = WANTED[0]!;
const WAIT = { timeout: 4500 };

/** Answers a request for the range of {@link FAILING}. */
type Failure = (response: ServerResponse) => void;

const withStatus =
  (status: number): Failure =>
  (response) =>
    response.writeHead(status).end();

let server: Server;
/** Taken one by one by the requests for that range; none is left: it is delivered. */
let failures: Failure[];
/** `without` of each plan that was asked for. */
let plans: (string | null)[];
let session: ClientSession;
let link: HttpLink;
let events: SessionEvent[];
let linkStates: LinkState[];

beforeEach(async () => {
  failures = [];
  plans = [];
  events = [];
  linkStates = [];
  server = createServer(answer);
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  session = new ClientSession({ client: "t", budgets: {}, creditBytes: 1 << 20 }, 1 << 20);
  link = new HttpLink({
    session,
    url: `http://127.0.0.1:${(server.address() as AddressInfo).port}/scenes/toy`,
    token: undefined,
    handle: (happened) => {
      events.push(...happened);
      for (const event of happened) {
        if (event.type === "whole") session.checked(event.key, TOY.find(({ key }) => key === event.key)!.bounds);
      }
    },
    onLinkState: (state) => linkStates.push(state),
  });
  session.land(MIDDLE, RADIUS_M);
});

afterEach(() => {
  link.leave();
  server.closeAllConnections();
  server.close();
});

function answer(request: IncomingMessage, response: ServerResponse): void {
  const { pathname, searchParams } = new URL(request.url!, "http://h");
  if (pathname.endsWith("/plan")) response.end(plan(searchParams.get("without")));
  else if (pathname.endsWith("/segments.pack")) answerRange(request.headers.range!, response);
  else response.end(MANIFEST);
}

function plan(without: string | null): Uint8Array {
  plans.push(without);
  const show = WANTED.filter(({ key }) => without?.includes(key) !== true);
  const offsets = Buffer.alloc(8 * show.length);
  show.forEach((segment, row) => {
    offsets.writeBigUInt64LE(BigInt(STRIDE_BYTES * WANTED.indexOf(segment)), 8 * row);
  });
  const fields = planOf(show, RADIUS_M, () => true);
  return encoded({ ...fields, generation: 0, pack: "segments.pack", offsets: new Uint8Array(offsets) });
}

function answerRange(range: string, response: ServerResponse): void {
  const begin = Number(/^bytes=(\d+)-/.exec(range)![1]);
  const segment = WANTED[begin / STRIDE_BYTES]!;
  const fail = segment === FAILING ? failures.shift() : undefined;
  if (fail === undefined) response.writeHead(206).end(segment.payload);
  else fail(response);
}

/** The end of the landing. */
async function ready(): Promise<Extract<SessionEvent, { type: "ready" }>> {
  const isReady = (event: SessionEvent) => event.type === "ready";
  return vi.waitFor(() => events.find(isReady) ?? expect.fail("is not ready"), WAIT);
}

test.each<[string, string, Failure]>([
  ["that is busy", "draining", withStatus(503)],
  ["that was asked too often", "too_many", withStatus(429)],
  ["behind a gateway that fails", "refused", withStatus(502)],
  ["whose connection is cut", "unreachable", (response) => response.destroy()],
  ["cut within its answer", "unreachable", (response) => response.writeHead(206).write("x", () => response.destroy())],
])("a pack %s is tried again after a while, and nothing is left out", async (_, code, failure) => {
  failures = [failure, failure];
  link.start();
  const { rows, missing } = await ready();
  expect(missing).toEqual([]);
  expect(rows).toHaveLength(WANTED.length);
  expect(plans).toEqual([null, null, null]);
  const waits = linkStates.filter(({ state }) => state === "waiting");
  expect(waits).toMatchObject([
    { code, attempt: 2 },
    { code, attempt: 3 },
  ]);
});

test.each([
  [401, "unauthorised"],
  [403, "forbidden"],
])("a pack that is refused with %d ends the stream", async (status, code) => {
  failures = [withStatus(status)];
  link.start();
  await vi.waitFor(() => expect(linkStates.at(-1)).toMatchObject({ state: "closed", code }), WAIT);
  expect(plans).toEqual([null]);
});

test.each<[string, Failure]>([
  ["has not (404)", withStatus(404)],
  ["has not (416)", withStatus(416)],
  ["has in another length", (response) => response.writeHead(206).end("short")],
])("what the pack %s is asked for twice, then left out", async (_, failure) => {
  failures = [failure, failure];
  link.start();
  const { rows, missing } = await ready();
  expect(missing).toEqual([FAILING.key]);
  expect(rows).toHaveLength(WANTED.length - 1);
  expect(plans).toEqual([null, null, FAILING.key]);
  expect(linkStates.map(({ state }) => state)).toEqual(["connecting", "open"]);
});
