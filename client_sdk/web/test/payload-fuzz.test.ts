/** Random and mutated bytes into the payload's decoders: a mesh or a cover comes out, or PayloadError, and nothing else. */

import { readdirSync, readFileSync } from "node:fs";
import { beforeAll, describe, expect, it, vi } from "vitest";
import { decodeCover } from "../src/core/payload/cover.ts";
import { PayloadError } from "../src/core/payload/errors.ts";
import { decodeGlb } from "../src/core/payload/glb.ts";
import { splitGlb } from "../src/core/payload/glb-container.ts";
import { prepareHash } from "../src/core/payload/hash.ts";
import { readImageHeader } from "../src/core/payload/image-header.ts";
import { decodeSegment } from "../src/core/payload/segment-format.ts";
import type { MeshData } from "../src/core/types.ts";
import { sealed } from "./cover-bytes.ts";
import { mutated, seeded } from "./seeded.ts";
import { imageOf, segmentWith, streamOf } from "./segment-bytes.ts";

vi.setConfig({ testTimeout: 60_000 });

const CORPUS = new URL("../../../tests/conformance/scene/", import.meta.url);
const GOLDEN = new URL("../../../tests/payload/golden_segments/", import.meta.url);
const MUTATIONS = 250;

const GLBS: [string, Uint8Array<ArrayBuffer>][] = readdirSync(new URL("payload/", CORPUS))
  .filter((name) => /^good-.*\.glb$/.test(name))
  .map((name) => [name, new Uint8Array(readFileSync(new URL(`payload/${name}`, CORPUS)))]);

/** Those of the corpus, and of the tests in Python. */
const SEGMENTS: [string, Uint8Array<ArrayBuffer>][] = [
  ...["colours", "image", "plain"].map((name) => new URL(`${name}.tsg`, GOLDEN)),
  ...["attributes", "jpeg", "no-strips", "regions"].map((name) => new URL(`payload/good-${name}.tsg`, CORPUS)),
].map((url) => [url.pathname.split("/").at(-1)!, new Uint8Array(readFileSync(url))]);
const SCALES = ["grade", "height_change_m"].map((name) => ({ name, offset: 0, step: 1 }));

beforeAll(prepareHash);

describe("a GLB", () => {
  it.each(GLBS)("%s, any bytes of it changed", async (name, bytes) => {
    const chance = seeded(bytes.length);
    for (let round = 0; round < MUTATIONS; round += 1) {
      await tryGlb(resized(mutated(bytes, chance)), `${name}, round ${round}`);
    }
  });

  it.each(GLBS)("%s, with another document", async (name, bytes) => {
    const chance = seeded(bytes.length + 1);
    let acceptedCount = 0;
    for (let round = 0; round < MUTATIONS; round += 1) {
      if (await tryGlb(withOtherJson(bytes, chance), `${name}, round ${round}`)) acceptedCount += 1;
    }
    // Names, extras and the like may change.
    expect(acceptedCount).toBeGreaterThan(0);
    expect(acceptedCount).toBeLessThan(MUTATIONS);
  });

  it.each(GLBS.slice(0, 2))("%s, every truncation", async (_name, bytes) => {
    for (let length = 0; length < bytes.length; length += 7) {
      await expect(decodeGlb(resized(bytes.slice(0, length)))).rejects.toBeInstanceOf(PayloadError);
    }
  });

  it("of a few bytes reserves nothing for a count of millions", async () => {
    const [, bytes] = GLBS.find(([name]) => name.includes("full"))!;
    const json = structuredClone(splitGlb(bytes).gltf) as Record<string, Record<string, unknown>[]>;
    for (const accessor of json.accessors!) accessor.count = 100_000_000;
    for (const view of json.bufferViews!) {
      const packed = (view.extensions as Record<string, Record<string, unknown>> | undefined)?.EXT_meshopt_compression;
      view.byteLength = 800_000_000;
      if (packed !== undefined) packed.count = 100_000_000;
    }
    const bytesBefore = process.memoryUsage().rss;
    await expect(decodeGlb(withJson(bytes, json))).rejects.toBeInstanceOf(PayloadError);
    expect(process.memoryUsage().rss - bytesBefore).toBeLessThan(100_000_000);
  });
});

describe("a segment", () => {
  it.each(SEGMENTS)("%s, any bytes of it changed", async (name, bytes) => {
    const chance = seeded(bytes.length);
    for (let round = 0; round < MUTATIONS; round += 1) {
      await trySegment(mutated(bytes, chance), `${name}, round ${round}`);
    }
  });

  it.each(SEGMENTS)("%s, its stream changed under a right checksum", async (name, bytes) => {
    const chance = seeded(bytes.length + 1);
    let acceptedCount = 0;
    for (let round = 0; round < MUTATIONS; round += 1) {
      const stream = streamOf(bytes);
      for (let step = 1 + chance(4); step > 0; step -= 1) stream[chance(stream.length)] = chance(256);
      if (await trySegment(segmentWith(stream, imageOf(bytes)), `${name}, round ${round}`)) acceptedCount += 1;
    }
    // Positions and the like may change.
    expect(acceptedCount).toBeGreaterThan(0);
    expect(acceptedCount).toBeLessThan(MUTATIONS);
  });

  it.each(SEGMENTS)("%s, every truncation", async (_name, bytes) => {
    for (let length = 0; length < bytes.length; length += 7) {
      await expect(decodeSegment(bytes.slice(0, length), 0, SCALES)).rejects.toBeInstanceOf(PayloadError);
    }
  });
});

describe("a cover", () => {
  const bytes = new Uint8Array(readFileSync(new URL("cover/good-many.cover", CORPUS)));

  it("with a byte changed is refused", () => {
    for (let at = 0; at < bytes.length; at += 1) {
      const changed = bytes.slice();
      changed[at]! ^= 0x10;
      expect(() => decodeCover(changed, 12, 40), `byte ${at}`).toThrow(PayloadError);
    }
  });

  it("with bytes changed under a right checksum is read or refused", () => {
    const chance = seeded(3);
    let acceptedCount = 0;
    for (let round = 0; round < 2_000; round += 1) {
      const data = sealed(mutated(bytes, chance));
      try {
        const cover = decodeCover(data, 12, 4096);
        expect(cover.offsets.length).toBe(13);
        expect(cover.offsets[12]).toBe(cover.segments.length);
        acceptedCount += 1;
      } catch (error) {
        if (!(error instanceof PayloadError)) throw new Error(`round ${round}`, { cause: error });
      }
    }
    expect(acceptedCount).toBeGreaterThan(10);
  });

  it("of another base is refused", () => {
    expect(() => decodeCover(bytes, 11, 40)).toThrow(PayloadError);
  });

  it("is read at any place of a larger buffer", () => {
    const larger = new Uint8Array(bytes.length + 3);
    larger.set(bytes, 3);
    expect(decodeCover(larger.subarray(3), 12, 40)).toEqual(decodeCover(bytes, 12, 40));
  });
});

it("random bytes are no cover, no GLB, no segment and no image", async () => {
  const chance = seeded(4);
  const starts = [
    [],
    [0xff, 0xd8, 0xff],
    [0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a],
    [...Buffer.from("RIFF....WEBPVP8X")],
    [...Buffer.from("TSG2")],
  ];
  for (let round = 0; round < 2_000; round += 1) {
    const start = starts[chance(starts.length)]!;
    const bytes = Uint8Array.from([...start, ...Array.from({ length: chance(64) }, () => chance(256))]);
    expect(() => decodeCover(bytes, 0, 1)).toThrow(PayloadError);
    await expect(decodeGlb(bytes)).rejects.toBeInstanceOf(PayloadError);
    await expect(decodeSegment(bytes, 0, [])).rejects.toBeInstanceOf(PayloadError);
    try {
      const { width, height } = readImageHeader(bytes);
      expect(Number.isInteger(width) && Number.isInteger(height)).toBe(true);
    } catch (error) {
      expect(error).toBeInstanceOf(PayloadError);
    }
  }
});

function tryGlb(bytes: Uint8Array<ArrayBuffer>, label: string): Promise<boolean> {
  return tryDecode(decodeGlb(bytes), label);
}

function trySegment(bytes: Uint8Array<ArrayBuffer>, label: string): Promise<boolean> {
  return tryDecode(decodeSegment(bytes, 0, SCALES), label);
}

/** True where it is taken; then it must be a mesh that a GPU can be given. */
async function tryDecode(decoding: Promise<MeshData>, label: string): Promise<boolean> {
  try {
    expectMesh(await decoding);
    return true;
  } catch (error) {
    if (!(error instanceof PayloadError)) throw new Error(label, { cause: error });
    return false;
  }
}

function expectMesh(mesh: MeshData): void {
  const { vertexCount } = mesh;
  expect(mesh.indices.length).toBe(3 * mesh.faceCount);
  expect(mesh.indices.every((index) => index < vertexCount)).toBe(true);
  expect(mesh.positions.length).toBe(vertexCount * (mesh.positions instanceof Float32Array ? 3 : 4));
  expect(mesh.normals.length).toBe(4 * vertexCount);
  for (const [values, width] of [
    [mesh.colours, 4],
    [mesh.uvs, 2],
    [mesh.regionIds, 2],
    ...mesh.attributes.map(({ codes }) => [codes, 2] as const),
  ] as const) {
    if (values !== null) expect(values.length).toBe(width * vertexCount);
  }
  expect(mesh.bounds.every(Number.isFinite)).toBe(true);
  expect(mesh.bounds[0] <= mesh.bounds[3]).toBe(true);
}

/** With the length in the header right again, so that what lies behind it is reached. */
function resized(bytes: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  if (bytes.length >= 12) new DataView(bytes.buffer).setUint32(8, bytes.length, true);
  return bytes;
}

/** One value somewhere in the document changed to another of any type. */
function withOtherJson(bytes: Uint8Array<ArrayBuffer>, chance: (below: number) => number): Uint8Array<ArrayBuffer> {
  const json = structuredClone(splitGlb(bytes).gltf) as Record<string, unknown>;
  let node: Record<string, unknown> = json;
  for (;;) {
    const keys = Object.keys(node);
    const key = keys[chance(keys.length)];
    if (key === undefined) break;
    const value = node[key];
    if (typeof value === "object" && value !== null && chance(6) !== 0) {
      node = value as Record<string, unknown>;
      continue;
    }
    if (chance(4) === 0) delete node[key];
    else node[key] = OTHERS[chance(OTHERS.length)];
    break;
  }
  return withJson(bytes, json);
}

const OTHERS: readonly unknown[] = [
  null,
  true,
  -1,
  0,
  1,
  2,
  3,
  7,
  1.5,
  65536,
  2 ** 31,
  1e300,
  "",
  "x",
  [],
  {},
  [1],
  { a: 1 },
];

function withJson(bytes: Uint8Array<ArrayBuffer>, json: unknown): Uint8Array<ArrayBuffer> {
  const { binary } = splitGlb(bytes);
  const text = Buffer.from(JSON.stringify(json));
  const head = Buffer.alloc(20);
  head.write("glTF", "latin1");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(28 + text.length + binary.length, 8);
  head.writeUInt32LE(text.length, 12);
  head.write("JSON", 16, "latin1");
  const chunk = Buffer.alloc(8);
  chunk.writeUInt32LE(binary.length, 0);
  chunk.write("BIN\0", 4, "latin1");
  return new Uint8Array(Buffer.concat([head, text, chunk, binary]));
}
