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

interface PartialPayload {
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
  readonly #partials = new Map<number, PartialPayload>();

  /** Segments that are partly here. */
  get size(): number {
    return this.#partials.size;
  }

  /** Bytes of one segment that are here already. */
  received(segment: number): number {
    return this.#partials.get(segment)?.received ?? 0;
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
    const partial = this.#partials.get(segment) ?? { chunks: [], received: 0 };
    if (frame.offset !== partial.received) {
      throw new ProtocolViolation(`segment ${segment} continues at byte ${frame.offset}, expected ${partial.received}`);
    }
    if (frame.last && partial.received === 0) return chunk;
    partial.chunks.push(chunk);
    partial.received += chunk.byteLength;
    this.#partials.set(segment, partial);
    if (!frame.last) return null;
    this.#partials.delete(segment);
    return joined(partial.chunks, partial.received);
  }

  /** Forget every part of a segment that is not among these. */
  keepOnly(segments: { has(segment: number): boolean }): void {
    for (const segment of [...this.#partials.keys()]) {
      if (!segments.has(segment)) this.#partials.delete(segment);
    }
  }

  /** Forget everything: the connection is gone. */
  clear(): void {
    this.#partials.clear();
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
