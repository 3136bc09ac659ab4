/** Checks of the payload's decoders that no file of the corpus reaches: each must fail by itself. */

import { readFileSync } from "node:fs";
import { beforeAll, expect, it } from "vitest";
import { gpuBytesOf } from "../src/core/gpu-budget.ts";
import { prepareDecoders } from "../src/core/payload/engines.ts";
import { decodeGlb } from "../src/core/payload/glb.ts";
import { splitGlb } from "../src/core/payload/glb-container.ts";

const CORPUS = new URL("../../../tests/conformance/scene/", import.meta.url);

beforeAll(prepareDecoders);

it("an array that reaches beyond the BIN chunk is refused, compressed or not", async () => {
  for (const name of ["good-plain.glb", "good-bare.glb", "good-full.glb"]) {
    const bytes = payload(name);
    const { gltf, binary } = splitGlb(bytes);
    const views = gltf.bufferViews as { byteOffset?: number; extensions?: Record<string, { byteOffset?: number }> }[];
    for (const view of views) {
      const bytesRange = view.extensions?.EXT_meshopt_compression ?? view;
      const offsetBefore = bytesRange.byteOffset;
      // Its first byte is inside, its last is not.
      bytesRange.byteOffset = binary.length - 1;
      await expect(decodeGlb(withJson(bytes, gltf), 0)).rejects.toThrow("expected within");
      if (offsetBefore === undefined) delete bytesRange.byteOffset;
      else bytesRange.byteOffset = offsetBefore;
    }
  }
});

it("an image of 4096 pixels is taken for the base, not for a segment", async () => {
  const bytes = payload("good-png.glb");
  const signature = Buffer.from(bytes).indexOf("IHDR");
  const view = new DataView(bytes.buffer);
  view.setUint32(signature + 4, 4096);
  await expect(decodeGlb(bytes, 0)).rejects.toThrow("at most 2048");
  expect((await decodeGlb(bytes, -1)).uvs).not.toBeNull();
  view.setUint32(signature + 4, 8192);
  await expect(decodeGlb(bytes, -1)).rejects.toThrow("at most 4096");
});

it("an image that does not open is a fault of the payload", async () => {
  const fails = () => Promise.reject(new DOMException("no picture", "InvalidStateError"));
  await expect(decodeGlb(payload("good-jpeg.glb"), 0, fails)).rejects.toThrow("does not decode");
});

it("a KTX2 image is handed over as what it is, and comes as the GPU keeps it", async () => {
  const compressed = { width: 16, height: 8, form: 0x9275, extension: "e", levels: [new Uint8Array(64)] };
  const mesh = await decodeGlb(payload("good-ktx2.glb"), 0, (_, mediaType) =>
    mediaType === "image/ktx2" ? Promise.resolve(compressed) : Promise.reject(new Error(mediaType)),
  );
  expect(mesh.image).toEqual({ mediaType: "image/ktx2", width: 16, height: 8, pixels: compressed });
  expect(gpuBytesOf(mesh)).toBe(gpuBytesOf({ ...mesh, image: null }) + 64);
});

it("what is decoded belongs to the caller, and the payload stays as it was", async () => {
  for (const name of ["good-plain.glb", "good-full.glb"]) {
    const bytes = payload(name);
    const original = bytes.slice();
    const mesh = await decodeGlb(bytes, 0);
    const buffers = [mesh.positions, mesh.normals, mesh.indices, mesh.colours, mesh.regionIds]
      .concat(mesh.attributes.map(({ codes }) => codes))
      .flatMap((values) => (values === null ? [] : [values.buffer as ArrayBuffer]));
    // Throws where a buffer is named twice, or is the payload's own.
    structuredClone(mesh, { transfer: buffers });
    expect(bytes).toEqual(original);
  }
});

function payload(name: string): Uint8Array<ArrayBuffer> {
  return new Uint8Array(readFileSync(new URL(`payload/${name}`, CORPUS)));
}

function withJson(bytes: Uint8Array<ArrayBuffer>, json: unknown): Uint8Array<ArrayBuffer> {
  const { binary } = splitGlb(bytes);
  const text = Buffer.from(JSON.stringify(json));
  const words = (...values: number[]) => Buffer.from(Uint32Array.from(values).buffer);
  const head = words(0x46546c67, 2, 28 + text.length + binary.length, text.length, 0x4e4f534a);
  return new Uint8Array(Buffer.concat([head, text, words(binary.length, 0x004e4942), binary]));
}
