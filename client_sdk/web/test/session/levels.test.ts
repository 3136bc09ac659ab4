/** Landings and aims with a ring of the coarser level: what is asked for. */

import { beforeAll, expect, it } from "vitest";
import { prepareHash, xxh3 } from "../../src/core/payload/hash.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import { decodeMessage, encodeMessage } from "../../src/core/wire/codec.ts";
import { type ClientMessage, PROTOCOL, type WelcomeMessage } from "../../src/core/wire/messages.generated.ts";

const HERE = [1, 2, 3] as const;
const MAX_RADIUS_M = 100;

beforeAll(prepareHash);

function welcome(maxRadiusM: number): Uint8Array<ArrayBuffer> {
  const message: WelcomeMessage = {
    type: "welcome",
    protocol: PROTOCOL,
    server: "test",
    session: "one",
    scene: { id: "pit", version: "0".repeat(32), name: "Pit", segment_count: 9, levels: 2 },
    limits: {
      max_radius_m: maxRadiusM,
      max_message_bytes: 1 << 20,
      max_messages_per_s: 100,
      max_held_segments: 100,
      max_credit_bytes: 1 << 20,
      max_plan_segments: 100,
      idle_timeout_s: 60,
    },
    release_factor: 1.25,
    dropped: [],
    held_count: 0,
  };
  return encodeMessage(message as never);
}

function opened(): ClientSession {
  const session = new ClientSession({ client: "test", budgets: {}, creditBytes: 1 << 20 }, 0, xxh3);
  session.connected();
  session.dataToSend();
  session.receive(welcome(MAX_RADIUS_M));
  return session;
}

function sent(session: ClientSession): ClientMessage[] {
  return session.dataToSend().map((data) => decodeMessage(data, "client_to_server") as ClientMessage);
}

it.each<[number, number | undefined, number | undefined, string]>([
  [10, 30, 30, "as it was asked for"],
  [10, 10, 10, "no wider than the radius: no ring"],
  [40, 120, MAX_RADIUS_M, "cut to what the server allows"],
  [120, 360, 120, "a radius that will be refused stays one that can be said"],
  [10, undefined, undefined, "none without"],
])("%d m with a ring to %s m says %s m: %s", (radiusM, coarseRadiusM, said, _why) => {
  const session = opened();
  session.land(HERE, radiusM, coarseRadiusM === undefined ? {} : { coarseRadiusM });
  expect(sent(session)).toMatchObject([{ type: "land", radius_m: radiusM }]);
  session.aim(HERE, radiusM, coarseRadiusM);
  session.flushAim();
  const [aim] = sent(session);
  expect(aim).toMatchObject({ type: "aim", radius_m: radiusM });
  expect((aim as { coarse_radius_m?: number }).coarse_radius_m).toBe(said);
});

it("a landing that waited for the connection is cut to what that one allows", () => {
  const session = new ClientSession({ client: "test", budgets: {}, creditBytes: 1 << 20 }, 0, xxh3);
  session.land(HERE, 40, { coarseRadiusM: 120 });
  session.connected();
  session.dataToSend();
  session.receive(welcome(MAX_RADIUS_M));
  expect(sent(session)).toMatchObject([{ type: "land", radius_m: 40, coarse_radius_m: MAX_RADIUS_M }]);
  session.connectionLost();
  session.connected();
  session.dataToSend();
  session.receive(welcome(60));
  expect(sent(session)).toMatchObject([{ type: "land", radius_m: 40, coarse_radius_m: 60 }]);
});

it("a ring within the radius is refused before anything is sent", () => {
  const session = opened();
  expect(() => session.land(HERE, 10, { coarseRadiusM: 9 })).toThrow(RangeError);
  expect(() => session.aim(HERE, 10, 9)).toThrow(RangeError);
  expect(sent(session)).toEqual([]);
});

it("ids of the coarser level begin where the served version's segments end", () => {
  expect(opened().segmentCount).toBe(9);
});
