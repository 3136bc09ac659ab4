/** What the corpus does not say: our own mistakes, tokens, what a client does after a close. */

import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { decodeMessage, encodeMessage, tokenSubprotocol } from "../src/core/wire/codec.ts";
import { afterClose, codeOfClose, InvalidMessageError } from "../src/core/wire/errors.ts";
import { isPayload } from "../src/core/wire/frames.ts";
import type { ClientMessage, ServerMessage } from "../src/core/wire/messages.generated.ts";
import { writeMsgpack } from "../src/core/wire/msgpack-writer.ts";
import type { Plain } from "../src/core/wire/plain.ts";

const SPEC = readFileSync(new URL("../../../spec/wire-protocol.md", import.meta.url), "utf-8");

describe("a message of our own that is not allowed", () => {
  it.each<[ClientMessage | ServerMessage, string]>([
    [{ type: "land", generation: 1, position: [0, 0, 0], radius_m: 0 }, "radius_m"],
    [{ type: "land", generation: 1, position: [0, Number.NaN, 0], radius_m: 1 }, "position"],
    [{ type: "land", generation: 1.5, position: [0, 0, 0], radius_m: 1 }, "generation"],
    [{ type: "land", generation: 1, position: [0, 0, 0], radius_m: 1, deadline_ms: 5 }, "deadline_ms"],
    [{ type: "land", generation: 1, position: [0, 0, 0], radius_m: 1, inner_radius_m: 2 }, "inner_radius_m"],
    [{ type: "evict", segments: [4, 9, 4] }, "segments"],
    [{ type: "evict", segments: [-1] }, "segments"],
    [{ type: "held", segments: [{ segment: 1, xxh3: 2n ** 64n }] }, "segments.xxh3"],
    [{ type: "credit", bytes: 2 ** 53 }, "bytes"],
    [{ type: "reject", generation: 1, segment: 1, reason: "\ud800" }, "reason"],
  ])("%o is not sent", (message, field) => {
    const encode = () => encodeMessage(message);
    expect(encode).toThrow(InvalidMessageError);
    expect(encode).toThrow(`${message.type}.${field}: `);
  });

  it("nor is one that is absent where it must be there", () => {
    const message = { type: "aim", generation: 1 } as unknown as ClientMessage;
    expect(() => encodeMessage(message)).toThrow("aim.position: got nothing");
  });
});

it("absent fields may be undefined, and are not written", () => {
  const message = { type: "pick", request: 3, origin: [1, 2, 3], direction: undefined } as const;
  expect(encodeMessage(message)).toEqual(encodeMessage({ type: "pick", request: 3, origin: [1, 2, 3] }));
});

it.each([
  [-0x80, "d080"],
  [-0x81, "d1ff7f"],
  [-0x8000, "d18000"],
  [-0x8001, "d2ffff7fff"],
  [-0x80000000, "d280000000"],
  [-0x80000001, "d3ffffffff7fffffff"],
  [0x7f, "7f"],
  [0xff, "ccff"],
  [0x100, "cd0100"],
  [0xffff, "cdffff"],
  [0x10000, "ce00010000"],
  [0xffffffff, "ceffffffff"],
  [0x100000000, "cf0000000100000000"],
])("%d takes the shortest form that holds it", (value, hex) => {
  expect(Buffer.from(writeMsgpack(value)).toString("hex")).toBe(hex);
});

it("names that every object has are names like any other", () => {
  const attributes = map({ ["__proto__"]: 1.5, constructor: 2, toString: 3 });
  const hit = { position: [0, 0, 0], normal: [0, 1, 0], segment: 1, region: 0, height_m: 0 };
  const picked = map({ type: "picked", request: 1, hit: map({ ...hit, attributes }) });
  const message = decodeMessage(writeMsgpack(picked), "server_to_client");
  if (message.type !== "picked") throw new Error("expected picked");
  expect(Object.entries(message.hit!.attributes)).toEqual([
    ["__proto__", 1.5],
    ["constructor", 2],
    ["toString", 3],
  ]);
  for (const type of ["constructor", "__proto__", "hasOwnProperty"]) {
    const unknown = decodeMessage(writeMsgpack(map({ type })), "server_to_client");
    expect(unknown).toEqual({ type: "unknown", name: type });
  }
});

it("a key that stands twice is refused, at every level", () => {
  // {"type": "bye", "x": 1, "x": 1} and {"type": "bye", "x": {"a": 1, "a": 1}}
  for (const tail of [
    [0x83, 0xa1, 0x78, 1, 0xa1, 0x78, 1],
    [0x82, 0xa1, 0x78, 0x82, 0xa1, 0x61, 1, 0xa1, 0x61, 1],
  ]) {
    const [size, ...rest] = tail;
    const bytes = Uint8Array.from([size!, 0xa4, ...Buffer.from("type"), 0xa3, ...Buffer.from("bye"), ...rest]);
    expect(() => decodeMessage(bytes, "client_to_server")).toThrow("twice");
  }
});

it("a stricter limit of size can be asked for", () => {
  const bytes = encodeMessage({ type: "bye" });
  expect(decodeMessage(bytes, "client_to_server", 10)).toEqual({ type: "bye" });
  expect(() => decodeMessage(bytes, "client_to_server", 9)).toThrow("got a message of 10 bytes, expected at most 9");
});

it("a text message is malformed", () => {
  expect(() => decodeMessage('{"type":"bye"}', "client_to_server")).toThrow("got a text message");
});

it("a token goes into a subprotocol's name, as the Python side reads it", () => {
  expect(tokenSubprotocol("abc")).toBe("terraport.token.YWJj");
  expect(tokenSubprotocol("ü~?>")).toBe("terraport.token.w7x-Pz4");
});

it("payload is told from messages by its first byte", () => {
  expect(isPayload(Uint8Array.of(0x01))).toBe(true);
  expect(isPayload(Uint8Array.of(0x81))).toBe(false);
  expect(isPayload(new Uint8Array())).toBe(false);
  expect(isPayload("\u0001")).toBe(false);
});

describe("after a close", () => {
  // | 4401 | unauthorised | ask for a token |
  const rows = [...SPEC.matchAll(/^\| ([0-9, ]+) \| [^|]+ \| (done|again|ask for a token|do not repeat) \|$/gm)];
  const meaning = { done: "done", again: "again", "ask for a token": "token", "do not repeat": "stop" } as const;

  it("a client does what the specification says", () => {
    expect(rows.length).toBe(12);
    for (const [, codes, action] of rows) {
      for (const code of codes!.split(", ")) {
        expect(`${code} ${afterClose(Number(code))}`).toBe(`${code} ${meaning[action as keyof typeof meaning]}`);
      }
    }
  });

  it("the code stands for an error", () => {
    expect(codeOfClose(4401)).toBe("unauthorised");
    expect(codeOfClose(4400)).toBe("malformed");
    expect(codeOfClose(1006)).toBe("closed");
  });
});

function map(members: Readonly<Record<string, Plain>>): Plain {
  return new Map(Object.entries(members));
}
