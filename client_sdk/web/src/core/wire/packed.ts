/** Tables of segments on the wire: one binary field of little-endian rows in msgpack, a list in JSON. */

import type { Bounds, SegmentFacts } from "../types.ts";
import type { HeldRow, PackedKind } from "./kinds.ts";
import { LIMITS } from "./messages.generated.ts";
import type { Plain, PlainMap } from "./plain.ts";
import { plainFloat, show, WholeFloat } from "./plain.ts";
import { below, Refused } from "./refused.ts";

/** Rows of any packed kind. */
export type PackedRows = readonly number[] | readonly HeldRow[] | readonly SegmentFacts[];

const ROW_BYTES = { ids: 4, held: 12, load: 48 } as const;
const U32 = 0xffffffff;
const HASH = /^[0-9a-f]{16}$/;

/** Read the rows; `checkRows` looks at what they say. */
export function readRows(kind: PackedKind, raw: Plain, packed: boolean): PackedRows {
  return packed ? readBinary(kind, raw) : readList(kind, raw);
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

/** The rows as msgpack's binary or JSON's list. */
export function writeRows(rows: PackedRows, kind: PackedKind, packed: boolean): Plain {
  if (!packed) return rows.map(listRow);
  const data = new Uint8Array(rows.length * ROW_BYTES[kind.name]);
  const view = new DataView(data.buffer);
  for (const [number, row] of rows.entries()) writeRow(view, number * ROW_BYTES[kind.name], row);
  return data;
}

function readBinary(kind: PackedKind, raw: Plain): PackedRows {
  const size = ROW_BYTES[kind.name];
  if (!(raw instanceof Uint8Array) || raw.length % size !== 0) {
    throw new Refused(`got ${show(raw)}, expected binary of a multiple of ${size} bytes`);
  }
  const count = raw.length / size;
  expectCount(kind, count);
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

function readList(kind: PackedKind, raw: Plain): PackedRows {
  if (!Array.isArray(raw)) throw new Refused(`got ${show(raw)}, expected a list`);
  expectCount(kind, raw.length);
  if (kind.name === "ids") return raw.map((item, number) => below(String(number), () => expectU32(item)));
  if (kind.name === "held") return raw.map((item, number) => below(String(number), () => heldRow(item)));
  return raw.map((item, number) => below(String(number), () => factsRow(item)));
}

function heldRow(item: Plain): HeldRow {
  if (!Array.isArray(item) || item.length !== 2) throw new Refused(`got ${show(item)}, expected [id, hash]`);
  return { segment: expectU32(item[0]), xxh3: expectHash(item[1]) };
}

function factsRow(item: Plain): SegmentFacts {
  if (!(item instanceof Map)) throw new Refused(`got ${show(item)}, expected a segment object`);
  const bounds = below("bounds", () => readBounds(item.get("bounds")));
  const whole = (name: string) => below(name, () => expectU32(item.get(name)));
  return {
    segment: whole("id"),
    length: whole("length"),
    xxh3: below("xxh3", () => expectHash(item.get("xxh3"))),
    faces: whole("faces"),
    vertices: whole("vertices"),
    bounds,
  };
}

function readBounds(value: Plain | undefined): Bounds {
  if (!Array.isArray(value) || value.length !== 6) throw new Refused(`got ${show(value)}, expected six numbers`);
  const side = (number: number): number => {
    const item = value[number];
    const size = item instanceof WholeFloat ? item.value : item;
    // What goes over the wire in msgpack is float32; the two subprotocols give the same numbers.
    if (typeof size === "number" && Math.abs(size) <= LIMITS.MAX_COORDINATE_M) return Math.fround(size);
    throw new Refused(`got ${show(item)}, expected a number of size at most ${LIMITS.MAX_COORDINATE_M}`);
  };
  return [side(0), side(1), side(2), side(3), side(4), side(5)];
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

function listRow(row: number | HeldRow | SegmentFacts): Plain {
  if (typeof row === "number") return row;
  if (!("bounds" in row)) return [row.segment, hashText(row.xxh3)];
  const members: PlainMap = new Map<string, Plain>([
    ["id", row.segment],
    ["length", row.length],
    ["xxh3", hashText(row.xxh3)],
    ["faces", row.faces],
    ["vertices", row.vertices],
    ["bounds", row.bounds.map((side) => plainFloat(Math.fround(side)))],
  ]);
  return members;
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

function expectCount(kind: PackedKind, count: number): void {
  if (count > kind.most) throw new Refused(`got ${count} rows, expected at most ${kind.most}`);
}

function expectU32(value: Plain | undefined): number {
  if (typeof value === "number" && Number.isInteger(value) && value >= 0 && value <= U32) return value;
  throw new Refused(`got ${show(value)}, expected an integer from 0 to ${U32}`);
}

function expectHash(value: Plain | undefined): bigint {
  if (typeof value === "string" && HASH.test(value)) return BigInt(`0x${value}`);
  throw new Refused(`got ${show(value)}, expected 16 hexadecimal digits (0-9a-f)`);
}

/** A hash as JSON has it: 16 hexadecimal digits, most significant first. */
export function hashText(hash: bigint): string {
  return hash.toString(16).padStart(16, "0");
}
