/** Inflates a gzip stream (RFC 1952) by the platform's own decoder, which checks the checksum. */

import { PayloadError } from "./errors.ts";

/** Header and trailer of a member. */
const MIN_BYTES = 18;
/** DEFLATE spends at least two bits on 258 bytes. */
const MAX_EXPANSION = 1032;

/**
 * Inflate one member, whose trailer says how much it becomes: no more is ever reserved.
 *
 * @throws PayloadError If it is damaged, cut short or longer than its trailer or `maxBytes` says.
 */
export async function inflate(packed: Uint8Array<ArrayBuffer>, maxBytes: number): Promise<Uint8Array<ArrayBuffer>> {
  const { buffer, byteOffset, length } = packed;
  const size = length < MIN_BYTES ? 0 : new DataView(buffer, byteOffset).getUint32(length - 4, true);
  if (length < MIN_BYTES || size > Math.min(maxBytes, MAX_EXPANSION * length)) {
    throw new PayloadError(`${length} bytes of gzip for ${size}, expected at most ${maxBytes}`);
  }
  const inflated = new Uint8Array(size);
  const { readable, writable } = new DecompressionStream("gzip");
  const [writer, reader] = [writable.getWriter(), readable.getReader()];
  let at = 0;
  try {
    // Not awaited: the decoder takes more only when what it made is read. Failures are the reader's as well.
    writer.write(packed).catch(() => {});
    writer.close().catch(() => {});
    for (let part = await reader.read(); !part.done; part = await reader.read()) {
      inflated.set(part.value, at);
      at += part.value.length;
    }
  } catch {
    throw new PayloadError("gzip stream is damaged or longer than its trailer says");
  }
  if (at !== size) throw new PayloadError(`gzip stream of ${at} bytes, expected ${size} by its trailer`);
  return inflated;
}
