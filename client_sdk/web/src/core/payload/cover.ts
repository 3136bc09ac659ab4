/** base.cover: which segments lie over each base face (scene format, section 8). */

import type { Cover } from "../types.ts";
import { PayloadError } from "./errors.ts";
import { xxh3 } from "./hash.ts";

const MAGIC = "TPCOVER1";
const MAJOR = 1;
const HEADER_BYTES = 32;
/** Base faces, and entries of all rows together: a few bytes can stand for any number of them. */
const MAX_ROWS = 2 ** 24;
/** Segments over one base face: bounds what one step costs. */
const MAX_ROW_SEGMENTS = 4096;
/** How many segments a step can name by half a byte. */
const RECENT = 15;

/**
 * Read `base.cover`; every truncation and flipped bit is noticed. Needs `prepareHash`.
 *
 * @param baseFaces Faces of the base mesh; the cover has one row for each.
 * @param segmentCount Segments of the scene; ids are below it.
 * @throws PayloadError
 */
export function decodeCover(bytes: Uint8Array, baseFaces: number, segmentCount: number): Cover {
  if (bytes.length < HEADER_BYTES) throw new PayloadError(`${bytes.length} bytes, expected ${HEADER_BYTES} or more`, 0);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const magic = String.fromCharCode(...bytes.subarray(0, 8));
  if (magic !== MAGIC) throw new PayloadError(`magic ${JSON.stringify(magic)}, expected ${MAGIC}`, 0);
  const major = view.getUint16(16, true);
  if (major !== MAJOR) throw new PayloadError(`format version ${major}, expected ${MAJOR}`, 16);
  const expected = view.getBigUint64(8, true);
  const actual = xxh3(bytes.subarray(16));
  if (actual !== expected) {
    throw new PayloadError(`checksum ${actual.toString(16)}, expected ${expected.toString(16)}`, 8);
  }
  // What the rows will take, before they take it.
  const start = view.getUint32(20, true);
  const rows = view.getUint32(24, true);
  const entries = view.getUint32(28, true);
  if (start < HEADER_BYTES || start > bytes.length) throw new PayloadError(`steps at ${start} of ${bytes.length}`, 20);
  if (rows !== baseFaces) throw new PayloadError(`cover of ${rows} base faces, expected ${baseFaces}`, 24);
  if (Math.max(rows, entries) > MAX_ROWS) {
    throw new PayloadError(`cover of ${rows} base faces and ${entries} entries, expected at most ${MAX_ROWS}`, 24);
  }
  return readRows(new StepReader(bytes, start), rows, entries, segmentCount);
}

/**
 * Walk the steps to the end of the file.
 *
 * Invariant: what has been given to faces is at most what the header counts. Rows ascend, as each segment goes in at its
 * place.
 */
function readRows(steps: StepReader, rows: number, entries: number, segmentCount: number): Cover {
  const offsets = new Uint32Array(rows + 1);
  const segments = new Uint32Array(entries);
  const row: number[] = [];
  let face = 0;
  let end = 0;
  while (face < rows) {
    const { at } = steps;
    const { segment, run } = steps.next();
    if (segment >= segmentCount) {
      throw new PayloadError(`segment ${segment} in the cover, expected below ${segmentCount}`, at);
    }
    toggle(row, segment);
    if (row.length > MAX_ROW_SEGMENTS) {
      throw new PayloadError(`more than ${MAX_ROW_SEGMENTS} segments over a base face`, at);
    }
    if (run > rows - face || run * row.length > entries - end) {
      const left = `${rows - face} faces and ${entries - end} entries`;
      throw new PayloadError(`${run} base faces of ${row.length} segments, expected ${left} at most`, at);
    }
    for (const last = face + run; face < last; face += 1) {
      for (let entry = 0; entry < row.length; entry += 1) segments[end + entry] = row[entry]!;
      end += row.length;
      offsets[face + 1] = end;
    }
  }
  if (!steps.isDone || end !== entries) {
    throw new PayloadError(`bytes or ${entries - end} entries left over, expected none`, steps.at);
  }
  return { offsets, segments };
}

/** Put a segment into an ascending row, or take it out. */
function toggle(row: number[], segment: number): void {
  let place = row.length;
  while (place > 0 && row[place - 1]! >= segment) place -= 1;
  if (row[place] === segment) row.splice(place, 1);
  else row.splice(place, 0, segment);
}

/** Steps, one after the other. */
class StepReader {
  at: number;
  readonly #bytes: Uint8Array;
  /** The segments that steps named last, the last one first. */
  readonly #recent: number[] = new Array<number>(RECENT).fill(0);

  constructor(bytes: Uint8Array, start: number) {
    this.#bytes = bytes;
    this.at = start;
  }

  get isDone(): boolean {
    return this.at === this.#bytes.length;
  }

  /** A segment that goes in or out of the row, and how many faces then have the row. */
  next(): { segment: number; run: number } {
    const step = this.#byte();
    const rank = step & 15;
    let segment = this.#recent[rank]!;
    if (rank === RECENT) {
      const ahead = this.#number();
      segment = (this.#recent[0]! + (ahead % 2 === 0 ? ahead / 2 : -(ahead + 1) / 2)) >>> 0;
    }
    this.#recent.copyWithin(1, 0, Math.min(rank, RECENT - 1));
    this.#recent[0] = segment;
    const run = step >> 4;
    return { segment, run: run === 15 ? 15 + this.#number() : run };
  }

  #byte(): number {
    const byte = this.#bytes[this.at];
    if (byte === undefined) throw new PayloadError("the steps end early", this.at);
    this.at += 1;
    return byte;
  }

  /** Seven bits a byte, lowest first; the top bit says that more follow. */
  #number(): number {
    let value = 0;
    for (let unit = 1; unit <= 2 ** 28; unit *= 128) {
      const byte = this.#byte();
      value += (byte & 0x7f) * unit;
      if (byte < 0x80) {
        if (value >= 2 ** 32) break;
        return value;
      }
    }
    throw new PayloadError("a number in the steps is beyond 32 bits", this.at);
  }
}
