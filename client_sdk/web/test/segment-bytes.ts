/** Segments taken apart and put together again. */

import { gunzipSync, gzipSync } from "node:zlib";

const OUTER_BYTES = 12;

/** A segment of that stream and image. */
export function segmentWith(stream: Uint8Array, image: Uint8Array): Uint8Array<ArrayBuffer> {
  const packed = gzipSync(stream);
  const outer = Buffer.alloc(OUTER_BYTES);
  outer.write("TSG2", "latin1");
  outer.writeUInt32LE(packed.length, 4);
  outer.writeUInt32LE(image.length, 8);
  return new Uint8Array(Buffer.concat([outer, packed, image]));
}

/** The bytes of its image. */
export function imageOf(segment: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  return segment.slice(OUTER_BYTES + new DataView(segment.buffer).getUint32(4, true));
}

/** The bytes of its stream, inflated. */
export function streamOf(segment: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  const end = segment.length - imageOf(segment).length;
  return new Uint8Array(gunzipSync(segment.subarray(OUTER_BYTES, end)));
}

/** The segment with its stream changed under a right checksum, and perhaps another image. */
export function withStream(
  segment: Uint8Array<ArrayBuffer>,
  change: (stream: DataView) => void,
  image = imageOf(segment),
): Uint8Array<ArrayBuffer> {
  const stream = streamOf(segment);
  change(new DataView(stream.buffer));
  return segmentWith(stream, image);
}
