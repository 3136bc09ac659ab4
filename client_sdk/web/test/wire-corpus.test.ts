/** The messages corpus (tests/conformance/messages): what a client reads, refuses and writes. */

import { readFileSync } from "node:fs";
import { describe, expect, test } from "vitest";
import { DecodeError } from "../src/core/wire/errors.ts";
import { decodeFrame, isFrame } from "../src/core/wire/frames.ts";
import { type ClientMessage, decodeMessage, encodeMessage, type PlanRow } from "../src/core/wire/messages.ts";
import { type Plain, readMsgpack, WholeFloat, writeMsgpack } from "../src/core/wire/msgpack.ts";

const CORPUS = new URL("../../../tests/conformance/messages/", import.meta.url);

interface Case {
  readonly case: string;
  readonly from: "client" | "server";
  readonly bytes: string;
  readonly pad_to?: number;
  readonly pad_byte?: number;
  readonly message?: { readonly type: string; readonly [field: string]: unknown };
  readonly frame?: Readonly<Record<string, unknown>>;
  readonly skip?: true;
  readonly refused_by?: "client" | "server";
}

function casesOf(file: string, from: Case["from"]): Case[] {
  const lines = readFileSync(new URL(file, CORPUS), "utf-8").trimEnd().split("\n");
  return lines.map((line) => JSON.parse(line) as Case).filter((one) => one.from === from);
}

describe("from a server", () => {
  const files = ["good.jsonl", "bad_from_server.jsonl", "frames.jsonl"];
  test.each(files.flatMap((file) => casesOf(file, "server")))("$case", (one) => {
    if (one.refused_by === "client") expect(() => received(one)).toThrow(DecodeError);
    else expect(received(one)).toEqual(one.skip ? null : (one.frame ?? one.message));
  });
});

describe("to a server", () => {
  const good = casesOf("good.jsonl", "client").filter(({ message }) => message !== undefined);
  test.each(good)("$case", ({ message }) => {
    const fields = Object.entries(message!).map(([name, value]) => {
      return [name, name === "have" || name === "without" ? keysOf(value as string) : value];
    });
    const bytes = encodeMessage(Object.fromEntries(fields) as ClientMessage);
    expect(plain(readMsgpack(bytes))).toEqual(message);
  });
});

/** What a client makes of a case, as the corpus tells it. */
function received(one: Case): unknown {
  const given = Buffer.from(one.bytes, "base64");
  const data = new Uint8Array(Math.max(given.length, one.pad_to ?? 0)).fill(one.pad_byte ?? 0);
  data.set(given);
  if (isFrame(data)) {
    const frame = decodeFrame(data);
    if (frame === null) return null;
    const { data: piece, ...numbers } = frame;
    const generation = new DataView(data.buffer).getUint32(4, true);
    return { generation, ...numbers, data: Buffer.from(piece).toString("base64") };
  }
  const message = decodeMessage(data);
  if (message === null) return null;
  const told = Object.entries(message).map(([name, value]) => [name, corpusValue(message.type, name, value)]);
  return Object.fromEntries(told);
}

/** A field as the corpus has it: binary in base64. */
function corpusValue(type: string, name: string, value: unknown): unknown {
  if (value instanceof Uint8Array) return Buffer.from(value).toString("base64");
  if (name === "show") return base64(28, value as PlanRow[], writeRow);
  if (name === "missing" && type === "ready") return base64(8, value as string[], writeKey);
  if (type === "gathered" && Array.isArray(value))
    return base64(4, value, (view, at, n) => view.setUint32(at, n, true));
  if (name === "offsets") return base64(8, value as number[], (view, at, n) => view.setBigUint64(at, BigInt(n), true));
  return value;
}

function base64<T>(width: number, rows: readonly T[], write: (view: DataView, at: number, row: T) => void): string {
  const view = new DataView(new ArrayBuffer(rows.length * width));
  rows.forEach((row, at) => {
    write(view, at * width, row);
  });
  return Buffer.from(view.buffer).toString("base64");
}

function writeKey(view: DataView, at: number, key: string): void {
  view.setBigUint64(at, BigInt(`0x${key}`), true);
}

function writeRow(view: DataView, at: number, { key, id, bytes, faces, vertices, follows, isCoarser }: PlanRow): void {
  writeKey(view, at, key);
  const flags = Number(follows) + 2 * Number(isCoarser);
  for (const [place, value] of [id, bytes, faces, vertices, flags].entries()) {
    view.setUint32(at + 8 + 4 * place, value, true);
  }
}

function keysOf(text: string): string[] {
  const bytes = Buffer.from(text, "base64");
  return Array.from({ length: bytes.length / 8 }, (_, at) => {
    return bytes
      .readBigUInt64LE(8 * at)
      .toString(16)
      .padStart(16, "0");
  });
}

/** A msgpack value as JSON has it. */
function plain(value: Plain): unknown {
  if (value instanceof Map) return Object.fromEntries([...value].map(([key, one]) => [key, plain(one)]));
  if (Array.isArray(value)) return value.map(plain);
  if (value instanceof WholeFloat) return value.value;
  return value instanceof Uint8Array ? Buffer.from(value).toString("base64") : value;
}

test("numbers stay whole where the writer's buffer grows in front of them", () => {
  for (let length = 230; length < 270; length++) {
    const padding = new Uint8Array(length);
    const numbers = [0.5, 2 ** 40, -(2 ** 40), 70_000];
    expect(readMsgpack(writeMsgpack([padding, ...numbers]))).toEqual([padding, ...numbers]);
  }
});
