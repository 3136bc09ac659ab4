/** A file of named arrays behind a directory, with a checksum: what base.cover is made of (scene format, section 5). */

import { xxh3 } from "./engines.ts";
import { PayloadError } from "./errors.ts";

const HEADER_BYTES = 48;
const ENTRY_BYTES = 96;
const NAME_BYTES = 72;
const MAX_FIELDS = 256;
const MAJOR = 1;
const ALIGNMENT = 8;

/** An array of one of the element types. */
export type FlatValues =
  | Int8Array
  | Uint8Array
  | Int16Array
  | Uint16Array
  | Uint32Array
  | Float32Array
  | BigUint64Array;

/** One array of a flat file: a view of the file's bytes. */
export interface FlatField {
  /** Values per row. */
  readonly components: number;
  readonly values: FlatValues;
}

/** A flat file: its arrays are views of the bytes that were read. */
export interface FlatFile {
  /** Number of segments, base faces or vertices. */
  readonly rows: number;
  readonly fields: ReadonlyMap<string, FlatField>;
}

type ViewOf = new (buffer: ArrayBuffer, offset: number, length: number) => FlatValues;

/** Element types by their code. */
const TYPES: ReadonlyMap<number, { readonly bytes: number; readonly View: ViewOf }> = new Map([
  [1, { bytes: 1, View: Int8Array }],
  [2, { bytes: 1, View: Uint8Array }],
  [3, { bytes: 2, View: Int16Array }],
  [4, { bytes: 2, View: Uint16Array }],
  [5, { bytes: 4, View: Uint32Array }],
  [6, { bytes: 4, View: Float32Array }],
  [7, { bytes: 8, View: BigUint64Array }],
]);

/**
 * Read a flat file; every flipped bit and every truncation is noticed. Needs `prepareDecoders`.
 *
 * @param magic The eight characters that name the kind of file.
 * @throws PayloadError With the offset: too short, wrong magic, unknown major version, wrong length or checksum, or a
 * directory entry that points outside the file.
 */
export function decodeFlat(file: Uint8Array<ArrayBuffer>, magic: string): FlatFile {
  // Views of whole numbers need aligned memory, which a piece of a larger buffer may not have.
  const bytes = file.byteOffset % ALIGNMENT === 0 ? file : file.slice();
  const size = bytes.length;
  if (size < HEADER_BYTES) throw new PayloadError(`${size} bytes, expected at least ${HEADER_BYTES} for the header`, 0);
  const view = new DataView(bytes.buffer, bytes.byteOffset, size);
  const actualMagic = String.fromCharCode(...bytes.subarray(0, 8));
  if (actualMagic !== magic) throw new PayloadError(`magic ${JSON.stringify(actualMagic)}, expected ${magic}`, 0);
  const major = view.getUint16(16, true);
  if (major !== MAJOR) throw new PayloadError(`format version ${major}, expected ${MAJOR}`, 16);
  const stated = view.getBigUint64(24, true);
  if (stated !== BigInt(size)) throw new PayloadError(`${size} bytes, expected ${stated} by the header`, 24);
  const checksum = view.getBigUint64(8, true);
  const actual = xxh3(bytes.subarray(16));
  if (actual !== checksum) {
    throw new PayloadError(`checksum ${actual.toString(16)}, expected ${checksum.toString(16)}`, 8);
  }
  return { rows: view.getUint32(40, true), fields: readDirectory(bytes, view) };
}

function readDirectory(bytes: Uint8Array<ArrayBuffer>, view: DataView): Map<string, FlatField> {
  const start = view.getUint32(20, true);
  const count = view.getUint32(32, true);
  const entryBytes = view.getUint32(36, true);
  if (count > MAX_FIELDS || entryBytes < ENTRY_BYTES || start < HEADER_BYTES) {
    throw new PayloadError(`${count} fields of ${entryBytes} bytes at ${start}, expected a directory`, 32);
  }
  if (start + count * entryBytes > bytes.length) {
    throw new PayloadError(`a directory of ${count} fields runs past the end at ${bytes.length}`, 32);
  }
  const fields = new Map<string, FlatField>();
  for (let number = 0; number < count; number += 1) {
    const at = start + number * entryBytes;
    const field = readField(bytes, view, at);
    if (field === null) continue;
    const name = nameAt(bytes, at);
    if (fields.has(name)) throw new PayloadError(`field ${JSON.stringify(name)} appears twice`, at);
    fields.set(name, field);
  }
  return fields;
}

/** The field whose entry lies at `at`; null for an element type of a later version. */
function readField(bytes: Uint8Array<ArrayBuffer>, view: DataView, at: number): FlatField | null {
  const type = TYPES.get(view.getUint8(at + NAME_BYTES));
  if (type === undefined) return null;
  const components = view.getUint8(at + 73);
  const rows = view.getUint32(at + 76, true);
  // Beyond 2^53 these are not exact, but then they are far beyond the file as well.
  const offset = Number(view.getBigUint64(at + 80, true));
  const length = Number(view.getBigUint64(at + 88, true));
  if (components < 1 || length !== rows * components * type.bytes) {
    throw new PayloadError(`${length} bytes for ${rows} rows of ${components} x ${type.bytes} bytes`, at);
  }
  if (offset % ALIGNMENT !== 0 || offset > bytes.length || length > bytes.length - offset) {
    const text = `an array at ${offset} with ${length} bytes, expected a multiple of 8 within ${bytes.length}`;
    throw new PayloadError(text, at);
  }
  const values = new type.View(bytes.buffer, bytes.byteOffset + offset, length / type.bytes);
  return { components, values };
}

function nameAt(bytes: Uint8Array, at: number): string {
  const raw = bytes.subarray(at, at + NAME_BYTES);
  let end = raw.length;
  while (end > 0 && raw[end - 1] === 0) end -= 1;
  try {
    return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(raw.subarray(0, end));
  } catch {
    throw new PayloadError("a field's name is not UTF-8", at);
  }
}
