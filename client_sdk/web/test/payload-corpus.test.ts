/** The payload corpus (tests/conformance/scene/payload): what the Python decoder gives, value for value. */

import { createHash } from "node:crypto";
import { readdirSync, readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { PayloadError } from "../src/core/payload/errors.ts";
import { readImageHeader } from "../src/core/payload/image-header.ts";
import { decodeSegment } from "../src/core/payload/segment-format.ts";
import type { AttributeScale, MeshData } from "../src/core/types.ts";

const CORPUS = new URL("../../../tests/conformance/scene/payload/", import.meta.url);
/** Float32 against float64. */
const EXACT = 4e-6;
/** Components are rounded to whole 127ths: by 0.5 each, and 0.5 * sqrt(3) together. */
const ROUNDED = 0.87 / 127;
const NAMES = readdirSync(CORPUS).filter((name) => name.endsWith(".tsg"));

interface Expected {
  readonly good: boolean;
  /** Of a segment: the scene's attributes. */
  readonly scales?: AttributeScale[];
  readonly error?: string;
  readonly positions: number[][];
  readonly faces: number[][];
  readonly normals: number[][];
  readonly colours: number[][] | null;
  readonly region_ids: number[] | null;
  readonly attributes: Record<string, (number | null)[]>;
  readonly uvs?: number[][];
  readonly texture?: { media_type: string; width: number; height: number; sha256: string; gpu_bytes: number };
}

describe("good", () => {
  it.each(namesOf(true))("%s", async (name) => {
    const expected = expectedOf(name);
    const mesh = await decode(name);
    expect(positionsOf(mesh)).toEqual(expected.positions);
    expect(rows(mesh.indices, 3, 3)).toEqual(expected.faces);
    expectClose(rows(mesh.normals, 4, 3).map(unit), expected.normals, ROUNDED);
    expect(mesh.colours === null ? null : rows(mesh.colours, 4, 3).map((row) => row.map(srgb))).toEqual(
      expected.colours,
    );
    expect(mesh.regionIds === null ? null : rows(mesh.regionIds, 2, 1).flat()).toEqual(expected.region_ids);
    expect(Object.fromEntries(mesh.attributes.map((attribute) => [attribute.name, valuesOf(attribute)]))).toEqual(
      expected.attributes,
    );
    expect(mesh.uvs === null).toBe(expected.uvs === undefined);
    if (mesh.uvs !== null) {
      const [u, v] = mesh.uvScale;
      expectClose(
        rows(mesh.uvs, 2, 2).map((code) => [code[0]! * u, code[1]! * v]),
        expected.uvs!,
        EXACT,
      );
      expect(expected.texture).toMatchObject(imageOf(name));
    }
    for (const axis of [0, 1, 2] as const) {
      const along = expected.positions.map((position) => position[axis]!);
      expect([mesh.bounds[axis], mesh.bounds[axis + 3]]).toEqual([Math.min(...along), Math.max(...along)]);
    }
  });
});

describe("bad", () => {
  it.each(namesOf(false))("%s", async (name) => {
    await expect(decode(name)).rejects.toBeInstanceOf(PayloadError);
  });
});

it("runs every segment of the corpus", () => {
  expect(namesOf(true).length).toBeGreaterThanOrEqual(15);
  expect(namesOf(false).length).toBeGreaterThanOrEqual(29);
});

function namesOf(isValid: boolean): string[] {
  return NAMES.filter((name) => expectedOf(name).good === isValid);
}

function decode(name: string): Promise<MeshData> {
  return decodeSegment(bytesOf(name), expectedOf(name).scales!);
}

function bytesOf(name: string): Uint8Array<ArrayBuffer> {
  return new Uint8Array(readFileSync(new URL(name, CORPUS)));
}

function expectedOf(name: string): Expected {
  return JSON.parse(readFileSync(new URL(`${name}.json`, CORPUS), "utf-8")) as Expected;
}

/** The first `width` of every `stride` values. */
function rows(values: ArrayLike<number>, stride: number, width: number): number[][] {
  return Array.from({ length: values.length / stride }, (_, row) =>
    Array.from({ length: width }, (_, column) => values[row * stride + column]!),
  );
}

/** As a shader does it: float32 throughout. */
function positionsOf(mesh: MeshData): number[][] {
  const stride = mesh.positions instanceof Float32Array ? 3 : 4;
  return rows(mesh.positions, stride, 3).map((codes) =>
    codes.map((code, axis) =>
      Math.fround(Math.fround(mesh.translation[axis]!) + Math.fround(Math.fround(mesh.stepM) * code)),
    ),
  );
}

function unit(signed: number[]): number[] {
  const values = signed.map((value) => Math.max(value / 127, -1));
  return values.map((value) => value / Math.hypot(...values));
}

/** The nearest sRGB level of a linear code (IEC 61966-2-1). */
function srgb(code: number): number {
  const linear = code / 65535;
  return Math.round(255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055));
}

function valuesOf({ offset, step, codes }: MeshData["attributes"][number]): (number | null)[] {
  return rows(codes, 2, 1).map(([code]) => (code === 65535 ? null : Math.fround(offset + step * code!)));
}

function expectClose(actual: number[][], expected: number[][], tolerance: number): void {
  expect(actual.length).toBe(expected.length);
  for (const [row, values] of actual.entries()) {
    for (const [column, value] of values.entries())
      expect(Math.abs(value - expected[row]![column]!)).toBeLessThan(tolerance);
  }
}

/** Of the image's own bytes, as the file in the payload is. */
function imageOf(name: string): object {
  const file = imageOfSegment(bytesOf(name));
  const { mediaType, width, height } = readImageHeader(file);
  return { media_type: mediaType, width, height, sha256: createHash("sha256").update(file).digest("hex") };
}

function imageOfSegment(bytes: Uint8Array<ArrayBuffer>): Uint8Array {
  return bytes.subarray(12 + new DataView(bytes.buffer).getUint32(4, true));
}
