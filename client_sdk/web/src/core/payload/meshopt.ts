/** meshoptimizer's decoder, compiled asynchronously: `prepareMeshopt` comes before `decompress`. */

import { MeshoptDecoder } from "meshoptimizer/decoder";

/** How a compressed buffer was written (`EXT_meshopt_compression`). */
export interface Compression {
  readonly mode: "ATTRIBUTES" | "TRIANGLES";
  readonly filter: "NONE" | "OCTAHEDRAL" | "EXPONENTIAL";
}

/** Make {@link decompress} ready in this thread; call it as often as you like. */
export function prepareMeshopt(): Promise<void> {
  return MeshoptDecoder.ready;
}

/**
 * Decompress rows into memory of their own. Lengths must have been checked; the codec looks at the rest.
 *
 * @throws Error If the bytes are no such buffer.
 */
export function decompress(
  packed: Uint8Array,
  rows: number,
  rowBytes: number,
  { mode, filter }: Compression,
): Uint8Array<ArrayBuffer> {
  const target = new Uint8Array(rows * rowBytes);
  MeshoptDecoder.decodeGltfBuffer(target, rows, rowBytes, packed, mode, filter);
  return target;
}
