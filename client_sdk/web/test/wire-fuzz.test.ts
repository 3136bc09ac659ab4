/**
 * Random and mutated bytes into the wire's decoders: a message comes out, or DecodeError, and nothing else.
 *
 * What does come out is written again and read again, and must be the same.
 */

import { readdirSync, readFileSync } from "node:fs";
import { expect, it, vi } from "vitest";
import { decodeMessage, encodeMessage } from "../src/core/wire/codec.ts";
import { DecodeError } from "../src/core/wire/errors.ts";
import { decodeFrame } from "../src/core/wire/frames.ts";
import type { Direction } from "../src/core/wire/kinds.ts";
import { readMsgpack } from "../src/core/wire/msgpack-reader.ts";
import { writeMsgpack } from "../src/core/wire/msgpack-writer.ts";
import type { Plain, PlainMap } from "../src/core/wire/plain.ts";
import { WholeFloat } from "../src/core/wire/plain.ts";
import { mutated, seeded } from "./seeded.ts";

vi.setConfig({ testTimeout: 60_000 });

const CORPUS = new URL("../../../tests/conformance/wire/good/", import.meta.url);
const MUTATIONS = 80;

interface Sample {
  readonly name: string;
  readonly kind: "message" | "frame";
  readonly direction: Direction;
  readonly bytes: Uint8Array<ArrayBuffer>;
}

const SAMPLES: Sample[] = readdirSync(CORPUS)
  .filter((name) => name.endsWith(".json"))
  .map((name) => {
    const facts = JSON.parse(readFileSync(new URL(name, CORPUS), "utf-8"));
    const bytes = new Uint8Array(readFileSync(new URL(name.replace(/json$/, "bin"), CORPUS)));
    return { name, kind: facts.kind, direction: facts.direction, bytes };
  });

it("mutated messages give a message or DecodeError", () => {
  let refused = 0;
  let acceptedCount = 0;
  for (const [number, sample] of SAMPLES.entries()) {
    const chance = seeded(number);
    for (let round = 0; round < MUTATIONS; round += 1) {
      const bytes = mutated(sample.bytes, chance);
      try {
        checkOnce({ ...sample, bytes });
        acceptedCount += 1;
      } catch (error) {
        if (!(error instanceof DecodeError)) throw new Error(`${sample.name}, round ${round}`, { cause: error });
        refused += 1;
      }
    }
  }
  // Both must happen, or the mutations say nothing.
  expect(acceptedCount).toBeGreaterThan(500);
  expect(refused).toBeGreaterThan(500);
});

it("random bytes give DecodeError", () => {
  const chance = seeded(1);
  for (let round = 0; round < 5_000; round += 1) {
    const bytes = Uint8Array.from({ length: chance(64) }, () => chance(256));
    for (const kind of ["message", "frame"] as const) {
      for (const direction of ["client_to_server", "server_to_client"] as const) {
        try {
          checkOnce({ name: "random", kind, direction, bytes });
        } catch (error) {
          if (!(error instanceof DecodeError)) throw new Error(`round ${round}`, { cause: error });
        }
      }
    }
  }
});

it("every truncation of a plan is refused", () => {
  for (const sample of SAMPLES.filter(({ name }) => name.startsWith("message-plan-full"))) {
    for (let length = 0; length < sample.bytes.length; length += 1) {
      const bytes = sample.bytes.slice(0, length);
      expect(() => checkOnce({ ...sample, bytes }), `${sample.name} at ${length}`).toThrow(DecodeError);
    }
  }
});

it("plain values come back as they were written", () => {
  const chance = seeded(2);
  for (let round = 0; round < 500; round += 1) {
    const value = plainValue(chance, 0);
    expect(readMsgpack(writeMsgpack(value))).toEqual(value);
  }
});

it("nothing is reserved for lengths that are only declared", () => {
  for (const token of [0xc6, 0xdb, 0xdd, 0xdf]) {
    expect(() => readMsgpack(Uint8Array.of(token, 0xff, 0xff, 0xff, 0xff))).toThrow(DecodeError);
  }
});

function checkOnce({ kind, direction, bytes }: Sample): void {
  if (kind === "frame") {
    decodeFrame(bytes);
    return;
  }
  const message = decodeMessage(bytes, direction);
  if (message.type === "unknown") return;
  expect(decodeMessage(encodeMessage(message), direction)).toEqual(message);
}

function plainValue(chance: (below: number) => number, depth: number): Plain {
  switch (chance(depth > 3 ? 8 : 10)) {
    case 0:
      return [null, true, false][chance(3)]!;
    case 1:
      return chance(2 ** 32) - 2 ** 31;
    case 2:
      return Number.MAX_SAFE_INTEGER - chance(3);
    case 3:
      return 2n ** 63n + BigInt(chance(1000));
    case 4:
      return new WholeFloat(chance(2 ** 31) * 2 ** chance(200) * (chance(2) === 0 ? 1 : -1));
    case 5:
      return (chance(2 ** 31) + 0.5) / 3 ** chance(60);
    case 6:
      return String.fromCodePoint(
        ...Array.from({ length: chance(40) }, () => [34, 92, 10, 0x41, 0xe9, 0x1d11e][chance(6)]!),
      );
    case 7:
      return Uint8Array.from({ length: chance(5) * 75 }, () => chance(256));
    case 8:
      return Array.from({ length: chance(6) }, () => plainValue(chance, depth + 1));
    default: {
      const map: PlainMap = new Map();
      for (let number = depth === 0 ? chance(40) : chance(4); number > 0; number -= 1)
        map.set(`k${number}`, plainValue(chance, depth + 1));
      return map;
    }
  }
}
