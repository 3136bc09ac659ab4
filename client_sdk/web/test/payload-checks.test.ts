/** Checks of the payload's decoders that no file of the corpus reaches: each must fail by itself. */

import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { gpuBytesOf } from "../src/core/gpu-budget.ts";
import { crc32 } from "../src/core/payload/crc32.ts";
import { PayloadError } from "../src/core/payload/errors.ts";
import { decodeSegment } from "../src/core/payload/segment-format.ts";
import { imageOf, segmentWith, withStream } from "./segment-bytes.ts";

const SCALES = [
  { name: "grade", offset: 0, step: 1 },
  { name: "height_change_m", offset: -256, step: 2 ** -7 },
];
const CORPUS = new URL("../../../tests/conformance/scene/", import.meta.url);

it("an image of 4096 pixels is taken for the base, not for a segment", async () => {
  const width = 26;
  const checksum = 36;
  const widened = (pixels: number) => {
    const image = withPngWidth(imageOf(payload("good-png.tsg")), pixels);
    return withStream(
      payload("good-png.tsg"),
      (stream) => {
        stream.setUint16(width, pixels, true);
        stream.setUint32(checksum, crc32(image), true);
      },
      image,
    );
  };
  expect((await decodeSegment(widened(2048), [])).uvScale[0]).toBe(2 ** -12);
  await expect(decodeSegment(widened(4096), [])).rejects.toThrow("at most 2048");
  expect((await decodeSegment(widened(4096), [], undefined, "base")).uvScale[0]).toBe(2 ** -13);
  await expect(decodeSegment(widened(8192), [], undefined, "base")).rejects.toThrow("at most 4096");
});

it("an image that does not open is a fault of the payload", async () => {
  const fails = () => Promise.reject(new DOMException("no picture", "InvalidStateError"));
  await expect(decodeSegment(payload("good-png.tsg"), [], fails)).rejects.toThrow("does not decode");
});

it("a KTX2 image is handed over as what it is, and comes as the GPU keeps it", async () => {
  const compressed = { width: 16, height: 8, form: 0x9275, extension: "e", levels: [new Uint8Array(64)] };
  const mesh = await decodeSegment(payload("good-ktx2.tsg"), [], (_, mediaType) =>
    mediaType === "image/ktx2" ? Promise.resolve(compressed) : Promise.reject(new Error(mediaType)),
  );
  expect(mesh.image).toEqual({ mediaType: "image/ktx2", width: 16, height: 8, pixels: compressed });
  expect(gpuBytesOf(mesh)).toBe(gpuBytesOf({ ...mesh, image: null }) + 64);
});

it("what is decoded belongs to the caller, and the payload stays as it was", async () => {
  for (const name of ["good-attributes.tsg", "good-regions.tsg"]) {
    const bytes = payload(name);
    const original = bytes.slice();
    const mesh = await decodeSegment(bytes, SCALES);
    const buffers = [mesh.positions, mesh.normals, mesh.indices, mesh.colours, mesh.regionIds]
      .concat(mesh.attributes.map(({ codes }) => codes))
      .flatMap((values) => (values === null ? [] : [values.buffer as ArrayBuffer]));
    // Throws where a buffer is named twice, or is the payload's own.
    structuredClone(mesh, { transfer: buffers });
    expect(bytes).toEqual(original);
  }
});

describe("a segment of more vertices than 16 bits can number", () => {
  /** Faces of three new vertices each, then one of the last, the first and the second vertex. */
  const segmentOf = (newFaces: number, oldWidth: 2 | 4) => {
    const [vertices, faces] = [3 * newFaces, newFaces + 1];
    const stream = new Uint8Array(
      40 + 2 * Math.ceil(faces / 8) + Math.ceil((3 * faces) / 8) + 3 * oldWidth + 8 * vertices,
    );
    const view = new DataView(stream.buffer);
    view.setUint32(0, vertices, true);
    view.setUint32(4, faces, true);
    view.setUint16(24, 65535, true);
    let at = 40;
    const setBits = (count: number, bytes: number) => {
      for (let bit = 0; bit < count; bit += 1) stream[at + (bit >>> 3)]! |= 1 << (bit & 7);
      at += bytes;
    };
    setBits(faces, 2 * Math.ceil(faces / 8)); // All start, none is left.
    setBits(vertices, Math.ceil((3 * faces) / 8));
    const differences = [vertices - 1, 1 - vertices, 1].map((difference) => {
      const signed = oldWidth === 2 ? (difference << 16) >> 16 : difference;
      return (signed << 1) ^ (signed >> 31);
    });
    for (let byte = 0; byte < oldWidth; byte += 1) {
      for (const zigzag of differences) stream[at++] = zigzag >>> (8 * byte);
    }
    return segmentWith(stream, new Uint8Array());
  };

  it.each([
    [21844, 2, Uint16Array],
    [21845, 2, Uint16Array],
    [21846, 4, Uint32Array],
  ] as const)("%d faces of new vertices", async (newFaces, oldWidth, kind) => {
    const { indices, vertexCount } = await decodeSegment(segmentOf(newFaces, oldWidth), []);
    expect(indices).toBeInstanceOf(kind);
    expect(vertexCount).toBe(3 * newFaces);
    expect([...indices.subarray(-6)]).toEqual([
      vertexCount - 3,
      vertexCount - 2,
      vertexCount - 1,
      vertexCount - 1,
      0,
      1,
    ]);
  });
});

it("a segment reserves nothing for counts that its bytes do not hold", async () => {
  const most = (at: number) =>
    withStream(payload("good-colours.tsg"), (stream) => stream.setUint32(at, 0x7fffffff, true));
  const bytesBefore = process.memoryUsage().rss;
  for (const at of [0, 4]) await expect(decodeSegment(most(at), [])).rejects.toBeInstanceOf(PayloadError);
  // The trailer of the gzip stream says how much it becomes.
  const claimed = payload("good-plain.tsg");
  new DataView(claimed.buffer).setUint32(claimed.length - 4, 2 ** 28, true);
  await expect(decodeSegment(claimed, [])).rejects.toThrow("expected at most");
  expect(process.memoryUsage().rss - bytesBefore).toBeLessThan(100_000_000);
});

it("a gzip stream whose trailer says too little or too much is refused", async () => {
  for (const change of [-1, 1]) {
    const bytes = payload("good-plain.tsg");
    const view = new DataView(bytes.buffer);
    view.setUint32(bytes.length - 4, view.getUint32(bytes.length - 4, true) + change, true);
    await expect(decodeSegment(bytes, [])).rejects.toBeInstanceOf(PayloadError);
  }
});

function withPngWidth(bytes: Uint8Array<ArrayBuffer>, pixels: number): Uint8Array<ArrayBuffer> {
  const changed = bytes.slice();
  new DataView(changed.buffer).setUint32(Buffer.from(changed).indexOf("IHDR") + 4, pixels);
  return changed;
}

function payload(name: string): Uint8Array<ArrayBuffer> {
  return new Uint8Array(readFileSync(new URL(`payload/${name}`, CORPUS)));
}
