/** Tables of segments on the wire: each one binary field of little-endian rows. */

import type { SegmentFacts } from "../types.ts";
import type { HeldRow, PackedKind } from "./kinds.ts";
import { LIMITS } from "./messages.generated.ts";
import type { Plain } from "./plain.ts";
import { show } from "./plain.ts";
import { Refused } from "./refused.ts";

/** Rows of any packed kind. */
export type PackedRows = readonly number[] | readonly HeldRow[] | readonly SegmentFacts[];

const ROW_BYTES = { ids: 4, held: 12, load: 48 } as const;
const U32 = 0xffffffff;

/** Read the rows; `checkRows` looks at what they say. */
export function readRows(kind: PackedKind, raw: Plain): PackedRows {
  const size = ROW_BYTES[kind.name];
  if (!(raw instanceof Uint8Array) || raw.length % size !== 0) {
    throw new Refused(`got ${show(raw)}, expected binary of a multiple of ${size} bytes`);
  }
  const count = raw.length / size;
  if (count > kind.most) throw new Refused(`got ${count} rows, expected at most ${kind.most}`);
  const view = new DataView(raw.buffer, raw.byteOffset, raw.byteLength);
  if (kind.name === "ids") return Array.from({ length: count }, (_, number) => view.getUint32(4 * number, true));
  if (kind.name === "held") {
    return Array.from({ length: count }, (_, number) => ({
      segment: view.getUint32(12 * number, true),
      xxh3: view.getBigUint64(12 * number + 4, true),
    }));
  }
  return Array.from({ length: count }, (_, number) => readFacts(view, 48 * number));
}

/** Check what goes beyond the layout: their number, each id once, lengths and boxes. */
export function checkRows(kind: PackedKind, rows: PackedRows): PackedRows {
  if (rows.length > kind.most) throw new Refused(`got ${rows.length} rows, expected at most ${kind.most}`);
  const ids = new Uint32Array(rows.length);
  for (const [number, row] of rows.entries()) ids[number] = expectU32(typeof row === "number" ? row : row.segment);
  ids.sort();
  for (let at = 1; at < ids.length; at += 1) {
    if (ids[at] === ids[at - 1]) throw new Refused(`got id ${ids[at]} twice, expected each id once`);
  }
  for (const row of rows) {
    if (typeof row === "number") break;
    if (row.xxh3 < 0n || row.xxh3 >> 64n !== 0n) throw new Refused("got a hash beyond 64 bits", "xxh3");
    if ("bounds" in row) checkFacts(row);
  }
  return rows;
}

/** Rows of a packed table as their little-endian bytes, without a length before them. */
export function writeRows(rows: PackedRows, kind: PackedKind): Uint8Array {
  const data = new Uint8Array(rows.length * ROW_BYTES[kind.name]);
  const view = new DataView(data.buffer);
  for (const [number, row] of rows.entries()) writeRow(view, number * ROW_BYTES[kind.name], row);
  return data;
}

function readFacts(view: DataView, at: number): SegmentFacts {
  const side = (number: number) => view.getFloat32(at + 24 + 4 * number, true);
  return {
    segment: view.getUint32(at, true),
    length: view.getUint32(at + 4, true),
    xxh3: view.getBigUint64(at + 8, true),
    faces: view.getUint32(at + 16, true),
    vertices: view.getUint32(at + 20, true),
    bounds: [side(0), side(1), side(2), side(3), side(4), side(5)],
  };
}

function checkFacts(row: SegmentFacts): void {
  expectU32(row.faces);
  expectU32(row.vertices);
  const { MAX_COORDINATE_M, MAX_SEGMENT_BYTES } = LIMITS;
  if (!(row.length >= 1 && row.length <= MAX_SEGMENT_BYTES && Number.isInteger(row.length))) {
    throw new Refused(`got a length of ${row.length}, expected 1 to ${MAX_SEGMENT_BYTES}`, "length");
  }
  const bounds = row.bounds;
  // A NaN fails the comparison, an infinity too.
  if (!bounds.every((side) => Math.abs(side) <= MAX_COORDINATE_M)) {
    throw new Refused(`got a coordinate that is no number of size at most ${MAX_COORDINATE_M}`, "bounds");
  }
  if (bounds[0] > bounds[3] || bounds[1] > bounds[4] || bounds[2] > bounds[5]) {
    throw new Refused("got a box whose min is above its max, expected min <= max", "bounds");
  }
}

function writeRow(view: DataView, at: number, row: number | HeldRow | SegmentFacts): void {
  if (typeof row === "number") {
    view.setUint32(at, row, true);
    return;
  }
  view.setUint32(at, row.segment, true);
  if (!("bounds" in row)) {
    view.setBigUint64(at + 4, row.xxh3, true);
    return;
  }
  view.setUint32(at + 4, row.length, true);
  view.setBigUint64(at + 8, row.xxh3, true);
  view.setUint32(at + 16, row.faces, true);
  view.setUint32(at + 20, row.vertices, true);
  for (const [number, side] of row.bounds.entries()) view.setFloat32(at + 24 + 4 * number, side, true);
}

function expectU32(value: number): number {
  if (Number.isInteger(value) && value >= 0 && value <= U32) return value;
  throw new Refused(`got ${show(value)}, expected an integer from 0 to ${U32}`);
}
