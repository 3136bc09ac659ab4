/** Segments whose checksum is right, and that cannot be decoded. The landings corpus has those with a wrong checksum. */

import { expect, test } from "vitest";
import { ClientSession } from "../../src/core/session/session.ts";
import { encodeMessage } from "../../src/core/wire/messages.ts";
import { AnsweringServer } from "../client/answering-server.ts";
import { MIDDLE, TOY, toyWithin } from "../client/toy-scene.ts";

/** A session and a server; `talk` carries messages between them until neither has more. */
function connected() {
  const session = new ClientSession({ client: "t", budgets: {}, creditBytes: 1 << 20 }, 1 << 20);
  const server = new AnsweringServer();
  const events: string[] = [];
  const talk = (): void => {
    for (let isQuiet = false; !isQuiet; ) {
      const messages = session.messagesToSend();
      for (const message of messages) server.receive(encodeMessage(message));
      for (let data = server.next(); data !== null; data = server.next()) session.receive(data);
      const happened = session.events();
      for (const event of happened) {
        events.push(event.type === "refused" ? `refused ${event.code}` : event.type);
        if (event.type !== "whole") continue;
        const { bounds } = TOY.find(({ key }) => key === event.key)!;
        session.checked(event.key, bounds);
      }
      isQuiet = messages.length === 0 && happened.length === 0;
    }
  };
  session.connected();
  talk();
  return { session, server, events, talk };
}

const lands = ({ received }: AnsweringServer) => received.filter(({ type }) => type === "land");

test("one is loaded again, then left out of the landing", () => {
  const { session, server, talk } = connected();
  session.land(MIDDLE, 3);
  talk();
  const [bad] = toyWithin(MIDDLE, 3);
  expect(session.shownKeys).toContain(bad!.key);
  session.damaged(bad!.key);
  talk();
  expect(lands(server)).toHaveLength(2);
  expect(lands(server)[1]).not.toHaveProperty("without");
  session.damaged(bad!.key);
  talk();
  expect(lands(server)).toHaveLength(3);
  const { without } = lands(server)[2] as { without?: Uint8Array };
  expect(Buffer.from(without!).readBigUInt64LE(0)).toBe(BigInt(`0x${bad!.key}`));
});

test("one that nothing shows is forgotten, and nothing is requested", () => {
  const { session, server, talk } = connected();
  session.land(MIDDLE, 3);
  talk();
  session.land([100, 0, 100], 1);
  talk();
  session.damaged(toyWithin(MIDDLE, 3)[0]!.key);
  talk();
  expect(lands(server)).toHaveLength(2);
});

test("a landing is given up where more of it cannot be decoded than may be left out", () => {
  const { session, events, talk } = connected();
  session.land(MIDDLE, 100);
  talk();
  expect(session.shownKeys.size).toBe(TOY.length);
  for (const [at, { key }] of TOY.entries()) {
    for (const _ of [1, 2]) {
      session.damaged(key);
      talk();
    }
    expect(events.includes("refused damaged")).toBe(at >= 64);
  }
});

test("a landing that was given up is made anew, with every segment, in another version", () => {
  const { session, server, talk } = connected();
  session.land(MIDDLE, 100);
  talk();
  for (const { key } of TOY) {
    for (const _ of [1, 2]) {
      session.damaged(key);
      talk();
    }
  }
  const before = lands(server).length;
  session.connectionLost();
  server.version = "v2";
  session.connected();
  talk();
  expect(session.shownKeys.size).toBe(0);
  session.landAgain();
  talk();
  expect(lands(server)).toHaveLength(before + 1);
  expect(lands(server).at(-1)).not.toHaveProperty("without");
  expect(session.shownKeys.size).toBe(TOY.length);
});
