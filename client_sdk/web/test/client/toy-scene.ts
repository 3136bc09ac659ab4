/** A scene small enough to check by brute force. */

import type { Bounds, SegmentFacts, Vec3 } from "../../src/core/types.ts";
import { random } from "../random.ts";

/** Segments along one side; boxes of 1 m with gaps of 1 m. */
export const GRID = 6;

/** Of the toy scene, metres. */
export const MIDDLE: Vec3 = [GRID, 0, GRID];

/** Two FNV-1a of 32 bit: stands in for XXH3, which the session is given from outside. */
export function toyHash(bytes: Uint8Array): bigint {
  let high = 0x811c9dc5;
  let low = 0x01234567;
  for (const byte of bytes) {
    high = Math.imul(high ^ byte, 0x01000193);
    low = Math.imul(low ^ byte, 0x01000193);
  }
  return (BigInt(high >>> 0) << 32n) | BigInt(low >>> 0);
}

/** Distance from a point to a box (6.1). */
export function distance(centre: Vec3, bounds: Bounds): number {
  let sum = 0;
  for (let axis = 0; axis < 3; axis++) {
    const gap = Math.max(bounds[axis]! - centre[axis]!, 0, centre[axis]! - bounds[axis + 3]!);
    sum += gap * gap;
  }
  return Math.sqrt(sum);
}

/** GRID x GRID segments in the plane y = 0; i is at (2 * (i % GRID), 0, 2 * floor(i / GRID)). */
export class ToyScene {
  readonly version: string;
  readonly payloads: Uint8Array<ArrayBuffer>[] = [];
  readonly facts: SegmentFacts[] = [];

  constructor(options: { seed?: number; version?: string; mostBytes?: number } = {}) {
    const { seed = 0, version = "v1", mostBytes = 900 } = options;
    this.version = version;
    const chance = random(seed);
    for (let segment = 0; segment < GRID * GRID; segment++) {
      const payload = Uint8Array.from({ length: 1 + Math.floor(chance() * mostBytes) }, () => chance() * 256);
      this.replace(segment, payload);
    }
  }

  replace(segment: number, payload: Uint8Array<ArrayBuffer>): void {
    const x = 2 * (segment % GRID);
    const z = 2 * Math.floor(segment / GRID);
    this.payloads[segment] = payload;
    this.facts[segment] = {
      segment,
      length: payload.length,
      xxh3: toyHash(payload),
      faces: 10,
      vertices: 12,
      bounds: [x, 0, z, x + 1, 0, z + 1],
    };
  }

  /** Brute force: ids of the segments that a landing shows. */
  within(centre: Vec3, radiusM: number): number[] {
    return this.facts.filter((row) => distance(centre, row.bounds) <= radiusM).map((one) => one.segment);
  }

  bytesOf(segments: readonly number[]): number {
    return segments.reduce((sum, segment) => sum + this.payloads[segment]!.length, 0);
  }
}
