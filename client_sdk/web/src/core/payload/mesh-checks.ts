/** What a GPU would not notice: numbers of vertices that are not there, normals without length, positions at infinity. */

import type { Bounds, MeshData } from "../types.ts";
import { PayloadError } from "./errors.ts";

/** Check that every face uses vertices that are there. */
export function checkIndices(indices: Uint16Array | Uint32Array, vertexCount: number): void {
  let last = 0;
  for (let at = 0; at < indices.length; at += 1) {
    const index = indices[at]!;
    if (index > last) last = index;
  }
  if (last >= vertexCount) throw new PayloadError(`a face uses vertex ${last}, expected below ${vertexCount}`);
}

/** Check that no normal (four entries each, the fourth is padding) has length 0. */
export function checkNormals(normals: Int8Array): void {
  for (let at = 0; at < normals.length; at += 4) {
    if ((normals[at]! | normals[at + 1]! | normals[at + 2]!) === 0) {
      throw new PayloadError(`normal ${at / 4} has length 0, expected 1`);
    }
  }
}

/** Box of the positions as they are stored: four entries a vertex in codes, three in floats, which must be finite. */
export function boundsOf(positions: Uint16Array | Float32Array): Bounds {
  const width = positions instanceof Float32Array ? 3 : 4;
  let [minX, minY, minZ] = [Number.POSITIVE_INFINITY, Number.POSITIVE_INFINITY, Number.POSITIVE_INFINITY];
  let [maxX, maxY, maxZ] = [Number.NEGATIVE_INFINITY, Number.NEGATIVE_INFINITY, Number.NEGATIVE_INFINITY];
  let sum = 0;
  for (let at = 0; at < positions.length; at += width) {
    const x = positions[at]!;
    const y = positions[at + 1]!;
    const z = positions[at + 2]!;
    if (x < minX) minX = x;
    if (x > maxX) maxX = x;
    if (y < minY) minY = y;
    if (y > maxY) maxY = y;
    if (z < minZ) minZ = z;
    if (z > maxZ) maxZ = z;
    // Zero for finite numbers; a NaN or an infinity makes NaN, and stays: comparisons would pass over a NaN.
    sum += 0 * (x + y + z);
  }
  if (Number.isNaN(sum)) throw new PayloadError("a position is not finite, expected finite numbers");
  return [minX, minY, minZ, maxX, maxY, maxZ];
}

/** The largest of every `width`-th entry, from `first` on. */
export function largest(values: Uint16Array, first: number, width: number): number {
  let maximum = 0;
  for (let at = first; at < values.length; at += width) {
    const value = values[at]!;
    if (value > maximum) maximum = value;
  }
  return maximum;
}

/** The box in metres of a box of codes, which are placed as the GPU places them. */
export function transformedBounds(
  codes: Bounds,
  { translation, stepM }: Pick<MeshData, "translation" | "stepM">,
): Bounds {
  const side = (axis: 0 | 1 | 2, code: number): number => {
    const value = Math.fround(translation[axis] + stepM * code);
    if (Number.isFinite(value)) return value;
    throw new PayloadError("a position beyond float32, expected finite numbers");
  };
  return [
    side(0, codes[0]),
    side(1, codes[1]),
    side(2, codes[2]),
    side(0, codes[3]),
    side(1, codes[4]),
    side(2, codes[5]),
  ];
}
