/** Random and mutated bytes into the payload's decoders: a mesh comes out, or PayloadError, and nothing else. */

import { readFileSync } from "node:fs";
import { describe, expect, it, vi } from "vitest";
import { PayloadError } from "../src/core/payload/errors.ts";
import { readImageHeader } from "../src/core/payload/image-header.ts";
import { decodeSegment } from "../src/core/payload/segment-format.ts";
import type { MeshData } from "../src/core/types.ts";
import { mutated, seeded } from "./seeded.ts";
import { imageOf, segmentWith, streamOf } from "./segment-bytes.ts";

vi.setConfig({ testTimeout: 60_000 });

const CORPUS = new URL("../../../tests/conformance/scene/", import.meta.url);
const GOLDEN = new URL("../../../tests/payload/golden_segments/", import.meta.url);
const MUTATIONS = 250;

/** Those of the corpus, and of the tests in Python. */
const SEGMENTS: [string, Uint8Array<ArrayBuffer>][] = [
  ...["colours", "image", "plain"].map((name) => new URL(`${name}.tsg`, GOLDEN)),
  ...["attributes", "jpeg", "no-strips", "regions"].map((name) => new URL(`payload/good-${name}.tsg`, CORPUS)),
].map((url) => [url.pathname.split("/").at(-1)!, new Uint8Array(readFileSync(url))]);
const SCALES = ["grade", "height_change_m"].map((name) => ({ name, offset: 0, step: 1 }));

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
      await expect(decodeSegment(bytes.slice(0, length), SCALES)).rejects.toBeInstanceOf(PayloadError);
    }
  });
});

it("random bytes are no segment and no image", async () => {
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
    await expect(decodeSegment(bytes, [])).rejects.toBeInstanceOf(PayloadError);
    try {
      const { width, height } = readImageHeader(bytes);
      expect(Number.isInteger(width) && Number.isInteger(height)).toBe(true);
    } catch (error) {
      expect(error).toBeInstanceOf(PayloadError);
    }
  }
});

function trySegment(bytes: Uint8Array<ArrayBuffer>, label: string): Promise<boolean> {
  return tryDecode(decodeSegment(bytes, SCALES), label);
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
