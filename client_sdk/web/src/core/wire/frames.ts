/** Payload frames: a piece of one segment in one binary WebSocket message (protocol, section 3). */

import { DecodeError } from "./errors.ts";
import { readKey, type SegmentKey } from "./kinds.ts";

/** A piece of a segment's payload. */
export interface Frame {
  readonly key: SegmentKey;
  /** Where the piece begins in the payload, bytes. */
  readonly offset: number;
  /** Length of the whole payload, bytes. */
  readonly total: number;
  /** A view of the received message. */
  readonly data: Uint8Array;
}

const SEGMENT = 0x01;
const FIRST_MESSAGE_BYTE = 0x80;
const HEADER_BYTES = 24;
const MAX_HEADER_BYTES = 1024;
const MAX_FRAME_BYTES = 128 * 1024;
const MAX_SEGMENT_BYTES = 64 * 2 ** 20;

/** Whether a WebSocket message is a frame and not a message: a msgpack map starts at 0x80. */
export function isFrame(data: Uint8Array | string): data is Uint8Array {
  return typeof data !== "string" && data.length > 0 && data[0]! < FIRST_MESSAGE_BYTE;
}

/**
 * Read a frame; null for a kind that is not known, which is skipped.
 *
 * @throws DecodeError if it is cut off, too long or contradicts itself.
 */
export function decodeFrame(bytes: Uint8Array): Frame | null {
  if (bytes.length > MAX_FRAME_BYTES || bytes[0] === 0) {
    throw new DecodeError("malformed", `got ${bytes.length} bytes of kind ${bytes[0]}, expected a frame`);
  }
  if (bytes[0] !== SEGMENT) return null;
  if (bytes.length < HEADER_BYTES) throw new DecodeError("malformed", `got ${bytes.length} bytes, expected a header`);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const header = view.getUint16(2, true);
  const [offset, total] = [view.getUint32(16, true), view.getUint32(20, true)];
  const data = bytes.subarray(header);
  const isHeader = header >= HEADER_BYTES && header <= MAX_HEADER_BYTES;
  if (!isHeader || total > MAX_SEGMENT_BYTES || data.length === 0 || offset + data.length > total) {
    const got = `got ${data.length} bytes at ${offset} of ${total} behind a header of ${header}`;
    throw new DecodeError("malformed", `${got}, expected a piece of a segment`);
  }
  return { key: readKey(view, 8), offset, total, data };
}
