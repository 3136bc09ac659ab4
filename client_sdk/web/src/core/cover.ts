/**
 * Which faces of the base mesh the shown segments hide.
 *
 * The rule (docs/topics/hand-off.md): a base face is hidden if and only if its list is not empty and every segment in it is
 * shown. Each face has one counter, the number of segments over it that are *not* shown, so a landing costs only the faces
 * under the segments that change. No distance, no geometry: the outcome depends on the set alone.
 *
 * PURE.
 */

import type { Cover } from "./types.ts";

/**
 * Incremental hidden-face mask of one base mesh: B faces, N entries of the cover.
 *
 * Building costs O(B + N) once, for the inverse lists; adding or removing a segment costs its entries.
 *
 * @example Three faces: under segment 0; under 0 and 1; under none.
 * ```ts
 * const cover = new CoverCounters({ offsets: Uint32Array.of(0, 1, 3, 3), segments: Uint32Array.of(0, 0, 1) });
 * cover.show([0]); // [0]: the faces whose state changed
 * cover.hidden; // [1, 0, 0]
 * ```
 */
export class CoverCounters {
  /** One byte per face, 1 where it must not be drawn. A live view: read only. */
  readonly hidden: Uint8Array;
  readonly faceCount: number;
  readonly #missing: Uint32Array;
  readonly #total: Uint32Array;
  /** Inverse CSR: the faces under segment s are `#faces[#starts[s] .. #starts[s + 1]]`, ascending. */
  readonly #starts: Uint32Array;
  readonly #faces: Uint32Array;
  readonly #shown = new Set<number>();
  #hiddenCount = 0;
  #hiddenHash = 0;

  /** Throws RangeError where the arrays are not a CSR: offsets from 0 to N, never falling; segments ascending per face. */
  constructor(cover: Cover) {
    checkRows(cover);
    const { offsets, segments } = cover;
    this.faceCount = offsets.length - 1;
    this.hidden = new Uint8Array(this.faceCount);
    this.#total = new Uint32Array(this.faceCount);
    let maxSegment = -1;
    for (const segment of segments) {
      maxSegment = Math.max(maxSegment, segment);
    }
    this.#starts = new Uint32Array(maxSegment + 2);
    for (const segment of segments) {
      this.#starts[segment + 1]! += 1;
    }
    for (let segment = 0; segment <= maxSegment; segment += 1) {
      this.#starts[segment + 1]! += this.#starts[segment]!;
    }
    // Counting sort: starts from the counts above, then each face to its segments; ascending, as faces come in order.
    const writeAt = this.#starts.slice();
    this.#faces = new Uint32Array(segments.length);
    for (let face = 0; face < this.faceCount; face += 1) {
      const end = offsets[face + 1]!;
      this.#total[face] = end - offsets[face]!;
      for (let entry = offsets[face]!; entry < end; entry += 1) {
        const segment = segments[entry]!;
        this.#faces[writeAt[segment]!] = face;
        writeAt[segment]! += 1;
      }
    }
    this.#missing = this.#total.slice();
  }

  /** Segments that count as shown at present. */
  get shown(): ReadonlySet<number> {
    return this.#shown;
  }

  /** Number of hidden faces. */
  get hiddenCount(): number {
    return this.#hiddenCount;
  }

  /** Hash of the set of hidden faces, whatever the order in which they came to be hidden: 32 bits. */
  get hiddenHash(): number {
    return this.#hiddenHash >>> 0;
  }

  /** Whether some but not all segments over a drawn face are shown: only there can base and detail overlap. */
  isRim(face: number): boolean {
    return this.#missing[face]! > 0 && this.#missing[face]! < this.#total[face]!;
  }

  /** Count one more segment as shown. Returns the faces that are hidden now and were not; a repeat changes nothing. */
  add(segment: number): Uint32Array {
    checkId(segment);
    if (this.#shown.has(segment)) {
      return NONE;
    }
    this.#shown.add(segment);
    return this.#changed(segment, (face) => {
      this.#missing[face]! -= 1;
      return this.#missing[face] === 0;
    });
  }

  /** Count a segment as no longer shown. Returns the faces that are to be drawn now and were not. */
  remove(segment: number): Uint32Array {
    if (!this.#shown.delete(segment)) {
      return NONE;
    }
    return this.#changed(segment, (face) => {
      this.#missing[face]! += 1;
      return this.#missing[face] === 1;
    });
  }

  /** Make exactly these segments the shown ones. Returns the faces whose state changed, ascending. */
  show(segments: Iterable<number>): Uint32Array {
    const target = new Set(segments);
    for (const segment of target) {
      checkId(segment);
    }
    // A face may be shown by one segment's leaving and hidden again by another's coming: those changed twice did not.
    const toggled = new Set<number>();
    const flip = (faces: Uint32Array): void => {
      for (const face of faces) {
        if (!toggled.delete(face)) {
          toggled.add(face);
        }
      }
    };
    for (const segment of [...this.#shown]) {
      if (!target.has(segment)) {
        flip(this.remove(segment));
      }
    }
    for (const segment of target) {
      flip(this.add(segment));
    }
    return Uint32Array.from(toggled).sort();
  }

  #changed(segment: number, crosses: (face: number) => boolean): Uint32Array {
    if (segment + 1 >= this.#starts.length) {
      return NONE; // It lies over no face: remembered, but it hides nothing.
    }
    const begin = this.#starts[segment]!;
    const end = this.#starts[segment + 1]!;
    const out = new Uint32Array(end - begin);
    let count = 0;
    for (let entry = begin; entry < end; entry += 1) {
      const face = this.#faces[entry]!;
      if (crosses(face)) {
        const hides = this.hidden[face] === 0;
        this.hidden[face] = hides ? 1 : 0;
        this.#hiddenCount += hides ? 1 : -1;
        this.#hiddenHash ^= mix32(face);
        out[count] = face;
        count += 1;
      }
    }
    return out.subarray(0, count);
  }
}

/** More rows than an index of 1 GiB, the most that there may be, has: nothing is allocated by an id beyond it. */
const MAX_SEGMENTS = 2 ** 25;

const NONE = new Uint32Array(0);

/** A well-mixed 32-bit number for an id: the finaliser of MurmurHash3 (A. Appleby, public domain) over id + 1. */
export function mix32(id: number): number {
  let h = Math.imul(id + 1, 0x9e3779b1);
  h = Math.imul(h ^ (h >>> 16), 0x85ebca6b);
  h = Math.imul(h ^ (h >>> 13), 0xc2b2ae35);
  return (h ^ (h >>> 16)) >>> 0;
}

function checkId(segment: number): void {
  if (!Number.isInteger(segment) || segment < 0) {
    throw new RangeError(`segment id ${segment}, expected a whole number of 0 or more`);
  }
}

function checkRows({ offsets, segments }: Cover): void {
  if (offsets.length < 1 || offsets[0] !== 0 || offsets[offsets.length - 1] !== segments.length) {
    throw new RangeError(
      `cover offsets run ${offsets[0]}..${offsets[offsets.length - 1]}, expected 0..${segments.length}`,
    );
  }
  for (const segment of segments) {
    if (segment >= MAX_SEGMENTS) {
      throw new RangeError(`cover names segment ${segment}, expected below ${MAX_SEGMENTS}`);
    }
  }
  for (let face = 0; face + 1 < offsets.length; face += 1) {
    const end = offsets[face + 1]!;
    if (end < offsets[face]!) {
      throw new RangeError(`cover offsets fall after face ${face}`);
    }
    for (let entry = offsets[face]! + 1; entry < end; entry += 1) {
      if (segments[entry]! <= segments[entry - 1]!) {
        throw new RangeError(
          `cover names segments ${segments[entry - 1]} and ${segments[entry]} of face ${face}, expected them ascending`,
        );
      }
    }
  }
}
