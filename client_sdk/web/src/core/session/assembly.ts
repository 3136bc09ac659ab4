/**
 * Chunks to payloads.
 *
 * A segment comes in chunks, in order, without gap or overlap (wire protocol, section 4). A newer landing may carry on
 * where an older one stopped; what it does not need is forgotten by both sides (6.5, rule 3).
 *
 * PURE.
 */

import type { PayloadFrame } from "../wire/frames.ts";
import { ProtocolViolation } from "./violation.ts";

interface Part {
  readonly chunks: Uint8Array<ArrayBuffer>[];
  received: number;
}

/**
 * The parts of segments that are on their way.
 *
 * Memory is bounded by what the server may send: each part's length is checked against the plan's, and a new plan
 * forgets the rest.
 */
export class Assembler {
  readonly #parts = new Map<number, Part>();

  /** Segments that are partly here. */
  get size(): number {
    return this.#parts.size;
  }

  /** Bytes of one segment that are here already. */
  received(segment: number): number {
    return this.#parts.get(segment)?.received ?? 0;
  }

  /**
   * Take one chunk, kept and not copied until the segment is whole; returns the payload when this was its last one.
   *
   * @param length - the payload's length by the load table.
   * @throws ProtocolViolation on a gap, an overlap, or a total that is not the plan's.
   */
  take(frame: Omit<PayloadFrame, "generation">, length: number): Uint8Array<ArrayBuffer> | null {
    const { segment, chunk } = frame;
    if (frame.total !== length) {
      throw new ProtocolViolation(`segment ${segment} announces ${frame.total} bytes, expected ${length} by the plan`);
    }
    const part = this.#parts.get(segment) ?? { chunks: [], received: 0 };
    if (frame.offset !== part.received) {
      throw new ProtocolViolation(`segment ${segment} continues at byte ${frame.offset}, expected ${part.received}`);
    }
    if (frame.last && part.received === 0) return chunk;
    part.chunks.push(chunk);
    part.received += chunk.byteLength;
    this.#parts.set(segment, part);
    if (!frame.last) return null;
    this.#parts.delete(segment);
    return joined(part.chunks, part.received);
  }

  /** Forget every part of a segment that is not among these. */
  keepOnly(segments: { has(segment: number): boolean }): void {
    for (const segment of [...this.#parts.keys()]) {
      if (!segments.has(segment)) this.#parts.delete(segment);
    }
  }

  /** Forget everything: the connection is gone. */
  clear(): void {
    this.#parts.clear();
  }
}

function joined(chunks: readonly Uint8Array<ArrayBuffer>[], bytes: number): Uint8Array<ArrayBuffer> {
  const payload = new Uint8Array(bytes);
  let at = 0;
  for (const chunk of chunks) {
    payload.set(chunk, at);
    at += chunk.byteLength;
  }
  return payload;
}
