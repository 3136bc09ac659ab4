/** The wire corpus (tests/conformance/wire), every file of it, both ways. */

import { readdirSync, readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { decodeMessage, encodeMessage } from "../src/core/wire/codec.ts";
import { DecodeError } from "../src/core/wire/errors.ts";
import { decodeFrame, encodeFrame } from "../src/core/wire/frames.ts";
import type { Direction } from "../src/core/wire/kinds.ts";
import { MESSAGES } from "../src/core/wire/messages.generated.ts";

/** Names of files that this client declines, with the reason; also in README.md, "Conformance". */
const DECLINED: ReadonlyMap<string, string> = new Map();

const CORPUS = new URL("../../../tests/conformance/wire/", import.meta.url);

interface Facts {
  readonly kind: "message" | "frame";
  readonly direction: Direction;
  readonly message?: unknown;
  readonly unknown?: string;
  readonly frame?: unknown;
  readonly canonical?: boolean;
  readonly error?: unknown;
  readonly pad_to?: number;
  readonly pad_byte?: number;
}

/** What a case holds, in the corpus's own terms. */
interface Observed {
  message?: unknown;
  unknown?: string;
  frame?: unknown;
  canonical?: boolean;
  error?: unknown;
}

const NAMES = { good: namesIn("good"), bad: namesIn("bad") };

describe("good", () => {
  it.each(NAMES.good)("%s", (name) => {
    const { facts, data } = readCase("good", name);
    const expected: Observed = {};
    if (facts.message !== undefined) expected.message = facts.message;
    if (facts.unknown !== undefined) expected.unknown = facts.unknown;
    if (facts.frame !== undefined) expected.frame = facts.frame;
    if (facts.canonical === true) expected.canonical = true;
    expect(observe(data, facts)).toEqual(expected);
  });
});

describe("bad", () => {
  it.each(NAMES.bad)("%s", (name) => {
    const { facts, data } = readCase("bad", name);
    expect(observe(data, facts)).toEqual({ error: facts.error });
  });
});

it("runs the whole corpus, with every message", () => {
  expect(NAMES.good.length + NAMES.bad.length).toBeGreaterThan(500);
  for (const types of Object.values(MESSAGES)) {
    for (const type of Object.keys(types)) {
      expect(NAMES.good).toContain(`message-${type}-minimal`);
      expect(NAMES.good).toContain(`message-${type}-full`);
    }
  }
  for (const name of DECLINED.keys()) expect([...namesIn("good", true), ...namesIn("bad", true)]).toContain(name);
});

function namesIn(folder: "good" | "bad", all = false): string[] {
  const names = readdirSync(new URL(`${folder}/`, CORPUS))
    .filter((name) => name.endsWith(".json"))
    .map((name) => name.slice(0, -".json".length))
    .sort();
  return all ? names : names.filter((name) => !DECLINED.has(name));
}

function readCase(folder: "good" | "bad", name: string): { facts: Facts; data: Uint8Array<ArrayBuffer> } {
  const facts = JSON.parse(readFileSync(new URL(`${folder}/${name}.json`, CORPUS), "utf-8")) as Facts;
  const stored = new Uint8Array(readFileSync(new URL(`${folder}/${name}.bin`, CORPUS)));
  const data = new Uint8Array(Math.max(stored.length, facts.pad_to ?? 0)).fill(facts.pad_byte ?? 0);
  data.set(stored);
  return { facts, data };
}

function observe(data: Uint8Array<ArrayBuffer>, facts: Facts): Observed {
  try {
    if (facts.kind === "frame") return { frame: frameFacts(data) };
    const message = decodeMessage(data, facts.direction);
    if (message.type === "unknown") return { unknown: message.name };
    const observed: Observed = { message: readable(message) };
    if (Buffer.compare(encodeMessage(message), data) === 0) observed.canonical = true;
    return observed;
  } catch (error) {
    if (!(error instanceof DecodeError)) throw error;
    return { error: errorFacts(error) };
  }
}

function frameFacts(data: Uint8Array<ArrayBuffer>): unknown {
  const frame = decodeFrame(data);
  if ("unknownKind" in frame) return { unknown_kind: frame.unknownKind };
  expect(decodeFrame(encodeFrame(frame))).toEqual(frame);
  const { chunk, ...facts } = frame;
  return { ...facts, chunk_hex: Buffer.from(chunk).toString("hex") };
}

function errorFacts(error: DecodeError): unknown {
  const facts = { code: error.code, fatal: error.fatal };
  const { field, generation, request } = error;
  return {
    ...facts,
    ...(field !== undefined && { field }),
    ...(generation !== undefined && { generation }),
    ...(request !== undefined && { request }),
  };
}

/** A message as the corpus states it: hashes as text, held rows as pairs, a segment's number as `id`. */
function readable(value: unknown): unknown {
  if (Array.isArray(value)) return value.map(readable);
  if (typeof value !== "object" || value === null) return value;
  if ("xxh3" in value && "segment" in value) {
    const { segment, xxh3, ...rest } = value as { segment: number; xxh3: bigint };
    const hash = xxh3.toString(16).padStart(16, "0");
    return "bounds" in rest ? { id: segment, xxh3: hash, ...rest } : [segment, hash];
  }
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, readable(item)]));
}
