/** GLB payloads and the base mesh to what the GPU is given (scene format, section 9). */

import type { MeshData } from "../types.ts";

/** Decodes an image file; `createImageBitmap` in a browser. */
export type DecodeImage = (bytes: Uint8Array<ArrayBuffer>, mediaType: string) => Promise<ImageBitmap>;

/**
 * Decode one GLB payload; arrays stay quantised. Needs `prepareDecoders`.
 *
 * Without `decodeImage` the mesh has no image, though its texture coordinates are there.
 *
 * @param segment Segment id; -1 for the base mesh.
 * @throws PayloadError For anything that is not a whole GLB of the profile.
 */
export function decodeGlb(
  _bytes: Uint8Array<ArrayBuffer>,
  _segment: number,
  _decodeImage?: DecodeImage,
): Promise<MeshData> {
  throw new Error("on its way");
}
