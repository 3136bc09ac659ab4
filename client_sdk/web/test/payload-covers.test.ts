/** The corpus of covers (tests/conformance/scene/cover): each is read as the Python reader reads it, or refused. */

import { readdirSync, readFileSync } from "node:fs";
import { beforeAll, describe, expect, it } from "vitest";
import { decodeCover } from "../src/core/payload/cover.ts";
import { PayloadError } from "../src/core/payload/errors.ts";
import { prepareHash } from "../src/core/payload/hash.ts";
import { coverBytes } from "./cover-bytes.ts";

const CORPUS = new URL("../../../tests/conformance/scene/cover/", import.meta.url);
const NAMES = readdirSync(CORPUS)
  .filter((name) => name.endsWith(".cover"))
  .map((name) => name.slice(0, -".cover".length));

interface Expected {
  readonly base_faces: number;
  readonly segment_count: number;
  readonly error?: string;
  readonly offsets: number[];
  readonly segments: number[];
}

beforeAll(prepareHash);

describe("good", () => {
  it.each(NAMES.filter((name) => name.startsWith("good")))("%s", (name) => {
    const { base_faces, segment_count, offsets, segments } = expectedOf(name);
    const cover = decodeCover(bytesOf(name), base_faces, segment_count);
    expect(Array.from(cover.offsets)).toEqual(offsets);
    expect(Array.from(cover.segments)).toEqual(segments);
    const error = `in the cover, expected below ${segment_count - 1}`;
    if (segments.length > 0) {
      expect(() => decodeCover(bytesOf(name), base_faces, segment_count - 1)).toThrow(error);
    }
  });
});

describe("bad", () => {
  it.each(NAMES.filter((name) => name.startsWith("bad")))("%s", (name) => {
    const { base_faces, segment_count } = expectedOf(name);
    expect(() => decodeCover(bytesOf(name), base_faces, segment_count)).toThrow(PayloadError);
  });
});

it("runs every file of the corpus", () => {
  expect(NAMES.filter((name) => name.startsWith("good")).length).toBeGreaterThanOrEqual(9);
  expect(NAMES.filter((name) => name.startsWith("bad")).length).toBeGreaterThanOrEqual(21);
});

it("a writer that knows nothing of neighbours is read as well", () => {
  const rows = [[], [1, 900], [1, 900], [900], [0, 1, 2, 70_000], []];
  const cover = decodeCover(coverBytes(rows), rows.length, 70_001);
  expect(Array.from(cover.offsets)).toEqual([0, 0, 2, 4, 5, 9, 9]);
  expect(Array.from(cover.segments)).toEqual(rows.flat());
});

function bytesOf(name: string): Uint8Array<ArrayBuffer> {
  return new Uint8Array(readFileSync(new URL(`${name}.cover`, CORPUS)));
}

function expectedOf(name: string): Expected {
  return JSON.parse(readFileSync(new URL(`${name}.json`, CORPUS), "utf-8")) as Expected;
}
