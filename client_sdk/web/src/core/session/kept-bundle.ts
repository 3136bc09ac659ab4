/**
 * Payloads as they are kept on disk from one visit to the next: a few of them in one run of bytes.
 *
 * A bundle is a u32 (little-endian) with the size of its head, the head (JSON), and the payloads in the head's order. Nothing
 * in it is trusted: a payload that has another hash than the head says is left out, and the server compares the hash with
 * that of its version (wire protocol, 5, rule 3).
 *
 * PURE.
 */

import type { SegmentFacts } from "../types.ts";
import type { CachedSegment } from "./cache.ts";

type Row = readonly [segment: number, length: number, xxh3: string, faces: number, vertices: number, bounds: number[]];

/** Write a bundle. */
export function writeBundle(entries: readonly CachedSegment[]): Uint8Array<ArrayBuffer> {
  const rows = entries.map(({ facts }): Row => {
    const { segment, length, xxh3, faces, vertices, bounds } = facts;
    return [segment, length, xxh3.toString(16), faces, vertices, [...bounds]];
  });
  const head = new TextEncoder().encode(JSON.stringify(rows));
  const bundle = new Uint8Array(entries.reduce((sum, { payload }) => sum + payload.byteLength, 4 + head.length));
  new DataView(bundle.buffer).setUint32(0, head.length, true);
  bundle.set(head, 4);
  let at = 4 + head.length;
  for (const { payload } of entries) {
    bundle.set(payload, at);
    at += payload.byteLength;
  }
  return bundle;
}

/** Read a bundle: what of it is whole, by the payloads' own hashes; nothing where its head cannot be read. */
export function readBundle(
  bundle: Uint8Array<ArrayBuffer>,
  xxh3: (bytes: Uint8Array) => bigint,
): readonly CachedSegment[] {
  const entries: CachedSegment[] = [];
  try {
    const headBytes = new DataView(bundle.buffer, bundle.byteOffset, bundle.byteLength).getUint32(0, true);
    const rows = JSON.parse(new TextDecoder().decode(bundle.subarray(4, 4 + headBytes))) as readonly Row[];
    let at = 4 + headBytes;
    for (const [segment, length, hash, faces, vertices, bounds] of rows) {
      // Copied: a view would keep the whole bundle in memory as long as one of its segments is held.
      const payload = bundle.slice(at, at + length);
      at += length;
      const facts = { segment, length, xxh3: BigInt(`0x${hash}`), faces, vertices, bounds } as unknown as SegmentFacts;
      if (payload.byteLength === length && xxh3(payload) === facts.xxh3) entries.push({ facts, payload });
    }
  } catch {
    // Written by another version, or cut short: what was read so far has its hash.
  }
  return entries;
}
