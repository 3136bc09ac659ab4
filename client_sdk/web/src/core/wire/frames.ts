/** Payload frames: one chunk of one segment in one binary WebSocket message (wire protocol, section 4). */

import { DecodeError, InvalidMessageError } from "./errors.ts";
import { LIMITS } from "./messages.generated.ts";

/** One chunk of a segment's payload. */
export interface PayloadFrame {
  /** Generation of the plan or prefetch that it is sent for. */
  readonly generation: number;
  readonly segment: number;
  /** Place of the chunk in the payload, bytes. */
  readonly offset: number;
  /** Length of the whole payload, bytes. */
  readonly total: number;
  /** The chunk ends the segment. */
  readonly last: boolean;
  /** A view of the received message, not a copy. */
  readonly chunk: Uint8Array<ArrayBuffer>;
}

/** A frame of a kind that this version does not know: skip it. */
export interface UnknownFrame {
  readonly unknownKind: number;
}

const KIND_SEGMENT_CHUNK = 0x01;
const FLAG_LAST = 0x01;
const FIRST_MESSAGE_BYTE = 0x80;

/** Whether a WebSocket message is a payload frame and not a message: text never is, a msgpack map starts at 0x80. */
export function isPayload(data: Uint8Array | string): data is Uint8Array {
  return typeof data !== "string" && data.length > 0 && data[0]! < FIRST_MESSAGE_BYTE;
}

/**
 * Read the frame that one binary WebSocket message holds.
 *
 * @throws DecodeError If it is cut off, too long, contradicts itself, or is no frame.
 */
export function decodeFrame(data: Uint8Array<ArrayBuffer>): PayloadFrame | UnknownFrame {
  const { HEADER_BYTES, MAX_FRAME_BYTES, MAX_HEADER_BYTES, MAX_SEGMENT_BYTES } = LIMITS;
  if (data.length > MAX_FRAME_BYTES) {
    throw new DecodeError("too_large", `got a frame of ${data.length} bytes, expected at most ${MAX_FRAME_BYTES}`);
  }
  const kind = data[0];
  if (kind === undefined) throw malformed("got an empty message, expected a frame", 0);
  if (kind === 0 || kind >= FIRST_MESSAGE_BYTE) {
    throw malformed(`got frame kind 0x${kind.toString(16).padStart(2, "0")}, expected 0x01 to 0x7f`, 0);
  }
  if (kind !== KIND_SEGMENT_CHUNK) return { unknownKind: kind };
  if (data.length < HEADER_BYTES) {
    throw malformed(`got ${data.length} bytes, expected a header of ${HEADER_BYTES}`, data.length);
  }
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const header = view.getUint16(2, true);
  if (header < HEADER_BYTES || header > MAX_HEADER_BYTES) {
    throw malformed(`got a header of ${header}, expected ${HEADER_BYTES} to ${MAX_HEADER_BYTES}`, 2);
  }
  const offset = view.getUint32(12, true);
  const total = view.getUint32(16, true);
  if (total > MAX_SEGMENT_BYTES) {
    throw new DecodeError("too_large", `got a segment of ${total} bytes, expected at most ${MAX_SEGMENT_BYTES}`, {
      offset: 16,
    });
  }
  const chunk = data.subarray(header);
  if (chunk.length === 0) throw malformed("got no payload bytes, expected at least one", data.length);
  const end = offset + chunk.length;
  if (end > total) throw malformed(`got ${chunk.length} bytes at ${offset}, expected to end within ${total}`, 12);
  const last = (view.getUint8(1) & FLAG_LAST) !== 0;
  if (last !== (end === total)) {
    throw malformed(`got last = ${last}, expected ${end === total} by offset and total`, 1);
  }
  return { generation: view.getUint32(4, true), segment: view.getUint32(8, true), offset, total, last, chunk };
}

/**
 * Write a frame. A server's part; here so that both directions are tested against one corpus.
 *
 * @throws InvalidMessageError If a number is out of range or the chunk lies outside the segment.
 */
export function encodeFrame(frame: Omit<PayloadFrame, "last">): Uint8Array<ArrayBuffer> {
  const { HEADER_BYTES, MAX_CHUNK_BYTES, MAX_SEGMENT_BYTES } = LIMITS;
  const length = frame.chunk.length;
  expectRange("generation", frame.generation, 0, 0xffffffff);
  expectRange("segment", frame.segment, 0, 0xffffffff);
  expectRange("total", frame.total, 1, MAX_SEGMENT_BYTES);
  expectRange("length", length, 1, MAX_CHUNK_BYTES);
  expectRange("offset", frame.offset, 0, frame.total - length);
  const data = new Uint8Array(HEADER_BYTES + length);
  const view = new DataView(data.buffer);
  view.setUint8(0, KIND_SEGMENT_CHUNK);
  view.setUint8(1, frame.offset + length === frame.total ? FLAG_LAST : 0);
  view.setUint16(2, HEADER_BYTES, true);
  view.setUint32(4, frame.generation, true);
  view.setUint32(8, frame.segment, true);
  view.setUint32(12, frame.offset, true);
  view.setUint32(16, frame.total, true);
  data.set(frame.chunk, HEADER_BYTES);
  return data;
}

function malformed(text: string, offset: number): DecodeError {
  return new DecodeError("malformed", text, { offset });
}

function expectRange(field: string, value: number, low: number, high: number): void {
  if (Number.isInteger(value) && value >= low && value <= high) return;
  throw new InvalidMessageError("frame", field, `got ${value}, expected ${low} to ${high}`);
}
