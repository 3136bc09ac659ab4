/**
 * A strict reader and a writer of msgpack values.
 *
 * Libraries hide what the protocol asks about: repeated keys, whether a number was an integer or a float, extension types.
 * Nothing is reserved for a length that the bytes at hand do not have.
 */

import { DecodeError } from "./errors.ts";

/** A received float whose value is whole: a generation of 7.0 is refused, a radius of 60.0 is not. */
export class WholeFloat {
  constructor(readonly value: number) {}
}

/** A map with text keys, each once. */
export type PlainMap = Map<string, Plain>;

/**
 * A value as received or to be sent. A `number` is an integer where it is whole, else a float; integers beyond 2^53 - 1 are
 * `bigint`; binary is a view of the message.
 */
export type Plain = null | boolean | string | number | bigint | WholeFloat | Uint8Array | Plain[] | PlainMap;

const MAX_ITEMS = 16_384;
const MAX_DEPTH = 16;
const DECODER = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });
const ENCODER = new TextEncoder();

/**
 * Read exactly one value.
 *
 * @throws DecodeError `malformed`: cut off, nested or counted beyond the limits, a token that no message uses, a key that is not
 * text or comes twice, text that is not UTF-8, bytes after the end.
 */
export function readMsgpack(data: Uint8Array): Plain {
  const reader = new Reader(data);
  const value = reader.value(0);
  reader.expectEnd();
  return value;
}

class Reader {
  readonly #data: Uint8Array;
  readonly #view: DataView;
  #at = 0;

  constructor(data: Uint8Array) {
    this.#data = data;
    this.#view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  }

  expectEnd(): void {
    const left = this.#data.length - this.#at;
    if (left > 0) throw malformed(`got ${left} bytes after the message, expected none`, this.#at);
  }

  /** @param depth - number of maps and arrays around the value. */
  value(depth: number): Plain {
    const start = this.#at;
    const token = this.#view.getUint8(this.#take(1));
    if (token <= 0x7f) return token;
    if (token >= 0xe0) return token - 0x100;
    if (token <= 0x8f) return this.#map(token & 0x0f, depth);
    if (token <= 0x9f) return this.#array(token & 0x0f, depth);
    if (token <= 0xbf) return this.#text(token & 0x1f);
    // The tokens of the msgpack specification except for extensions, which no message uses.
    switch (token) {
      case 0xc0:
        return null;
      case 0xc2:
      case 0xc3:
        return token === 0xc3;
      case 0xc4:
      case 0xc5:
      case 0xc6:
        return this.#binary(this.#unsigned(token - 0xc4));
      case 0xca:
        return plainFloat(this.#view.getFloat32(this.#take(4)));
      case 0xcb:
        return plainFloat(this.#view.getFloat64(this.#take(8)));
      case 0xcc:
      case 0xcd:
      case 0xce:
        return this.#unsigned(token - 0xcc);
      case 0xcf:
        return exact(this.#view.getBigUint64(this.#take(8)));
      case 0xd0:
        return this.#view.getInt8(this.#take(1));
      case 0xd1:
        return this.#view.getInt16(this.#take(2));
      case 0xd2:
        return this.#view.getInt32(this.#take(4));
      case 0xd3:
        return exact(this.#view.getBigInt64(this.#take(8)));
      case 0xd9:
      case 0xda:
      case 0xdb:
        return this.#text(this.#unsigned(token - 0xd9));
      case 0xdc:
      case 0xdd:
        return this.#array(this.#unsigned(token - 0xdb), depth);
      case 0xde:
      case 0xdf:
        return this.#map(this.#unsigned(token - 0xdd), depth);
      default:
        throw malformed(`got msgpack token 0x${token.toString(16)}, which no message uses`, start);
    }
  }

  /** Move on by so many bytes, which must be there; returns where they start. */
  #take(length: number): number {
    const start = this.#at;
    const left = this.#data.length - start;
    if (length > left) throw malformed(`got ${left} bytes, expected ${length} of a value`, start);
    this.#at = start + length;
    return start;
  }

  /** Read an unsigned integer of 1, 2 or 4 bytes. */
  #unsigned(power: number): number {
    const start = this.#take(2 ** power);
    if (power === 0) return this.#view.getUint8(start);
    return power === 1 ? this.#view.getUint16(start) : this.#view.getUint32(start);
  }

  #binary(length: number): Uint8Array {
    const start = this.#take(length);
    return this.#data.subarray(start, this.#at);
  }

  #text(length: number): string {
    const start = this.#at;
    const bytes = this.#binary(length);
    try {
      return DECODER.decode(bytes);
    } catch {
      throw malformed("got text that is not UTF-8", start);
    }
  }

  #array(count: number, depth: number): Plain[] {
    this.#expectContainer(count, depth);
    const values: Plain[] = [];
    for (let number = 0; number < count; number += 1) values.push(this.value(depth + 1));
    return values;
  }

  #map(count: number, depth: number): PlainMap {
    this.#expectContainer(count, depth);
    const values: PlainMap = new Map();
    for (let number = 0; number < count; number += 1) {
      const at = this.#at;
      const key = this.value(depth + 1);
      if (typeof key !== "string") throw malformed(`got key ${show(key)}, expected text`, at);
      if (values.has(key)) throw malformed(`got key ${show(key)} twice, expected each key once`, at);
      values.set(key, this.value(depth + 1));
    }
    return values;
  }

  #expectContainer(count: number, depth: number): void {
    if (count > MAX_ITEMS) throw malformed(`got ${count} items, expected at most ${MAX_ITEMS}`, this.#at);
    if (depth >= MAX_DEPTH) throw malformed(`got nesting beyond ${MAX_DEPTH} levels`, this.#at);
  }
}

function plainFloat(value: number): number | WholeFloat {
  return Number.isInteger(value) ? new WholeFloat(value) : value;
}

/** An integer of 64 bits: a number where that is exact. */
function exact(value: bigint): number | bigint {
  const number = Number(value);
  return Number.isSafeInteger(number) ? number : value;
}

function malformed(text: string, offset: number): DecodeError {
  return new DecodeError("malformed", `${text} (at byte ${offset})`);
}

/** Write one value: integers up to 2^53 - 1 in their shortest form, floats in 64 bits. */
export function writeMsgpack(value: Plain): Uint8Array<ArrayBuffer> {
  const writer = new Writer();
  writer.value(value);
  return writer.bytes();
}

class Writer {
  #data = new Uint8Array(256);
  #view = new DataView(this.#data.buffer);
  #at = 0;

  bytes(): Uint8Array<ArrayBuffer> {
    return this.#data.slice(0, this.#at);
  }

  value(value: Plain): void {
    if (value === null) this.#sized(0xc0, 0, 0);
    else if (typeof value === "boolean") this.#sized(value ? 0xc3 : 0xc2, 0, 0);
    else if (typeof value === "number" && Number.isSafeInteger(value)) this.#integer(value);
    else if (typeof value === "number") {
      const at = this.#token(0xcb, 8); // first: it may replace the view
      this.#view.setFloat64(at, value);
    } else if (typeof value === "string") {
      const bytes = ENCODER.encode(value);
      this.#head(bytes.length, 0xa0, 31, 0xd9, 0);
      this.#raw(bytes);
    } else if (value instanceof Uint8Array) {
      this.#head(value.length, 0, -1, 0xc4, 0);
      this.#raw(value);
    } else if (Array.isArray(value)) {
      this.#head(value.length, 0x90, 15, 0xdc, 1);
      for (const item of value) this.value(item);
    } else if (value instanceof Map) {
      this.#head(value.size, 0x80, 15, 0xde, 1);
      for (const [key, item] of value) {
        this.value(key);
        this.value(item);
      }
    } else throw new TypeError(`got ${show(value)}, expected a value that a client sends`);
  }

  #integer(value: number): void {
    if (value >= -0x20 && value <= 0x7f) this.#sized(value & 0xff, 0, 0);
    else if (value >= 0 && value <= 0xff) this.#sized(0xcc, 1, value);
    else if (value >= 0 && value <= 0xffff) this.#sized(0xcd, 2, value);
    else if (value >= 0 && value <= 0xffffffff) this.#sized(0xce, 4, value);
    else {
      const at = this.#token(value >= 0 ? 0xcf : 0xd3, 8);
      this.#view.setBigInt64(at, BigInt(value)); // safe integers have the same bits, signed or not
    }
  }

  /** A count: in the token itself up to `inToken`, else behind it in 2^`power` bytes or more. */
  #head(count: number, short: number, inToken: number, token: number, power: 0 | 1): void {
    if (count <= inToken) this.#sized(short | count, 0, 0);
    else if (power === 0 && count <= 0xff) this.#sized(token, 1, count);
    else if (count <= 0xffff) this.#sized(token + 1 - power, 2, count);
    else this.#sized(token + 2 - power, 4, count);
  }

  /** A token, and an unsigned integer of `width` bytes. */
  #sized(token: number, width: 0 | 1 | 2 | 4, value: number): void {
    const at = this.#token(token, width);
    if (width === 1) this.#view.setUint8(at, value);
    else if (width === 2) this.#view.setUint16(at, value);
    else if (width === 4) this.#view.setUint32(at, value);
  }

  /** A token with room for so many bytes behind it; returns where they start. */
  #token(token: number, length: number): number {
    const start = this.#grow(1 + length);
    this.#view.setUint8(start, token);
    return start + 1;
  }

  #raw(bytes: Uint8Array): void {
    const at = this.#grow(bytes.length);
    this.#data.set(bytes, at);
  }

  #grow(length: number): number {
    const start = this.#at;
    this.#at = start + length;
    if (this.#at > this.#data.length) {
      const larger = new Uint8Array(Math.max(2 * this.#data.length, this.#at));
      larger.set(this.#data.subarray(0, start));
      this.#data = larger;
      this.#view = new DataView(larger.buffer);
    }
    return start;
  }
}

/** Show a value in an error text, at most a few dozen characters of it. */
export function show(value: unknown): string {
  if (value === null || value === undefined) return "nothing";
  if (typeof value === "string") return JSON.stringify(value.length > 48 ? `${value.slice(0, 48)}...` : value);
  if (value instanceof WholeFloat) return `${value.value}.0`;
  if (value instanceof Uint8Array) return `${value.length} bytes of binary`;
  if (value instanceof Map) return `a map of ${value.size}`;
  if (Array.isArray(value)) return `a list of ${value.length}`;
  return typeof value === "object" ? "an object" : String(value);
}
