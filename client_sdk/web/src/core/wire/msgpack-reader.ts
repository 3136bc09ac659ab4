/**
 * A strict reader of one msgpack value.
 *
 * Libraries hide what the protocol asks about: repeated keys, whether a number was an integer or a float, extension
 * types. Nothing is reserved for a length that the bytes at hand do not have.
 */

import { DecodeError } from "./errors.ts";
import { LIMITS } from "./messages.generated.ts";
import type { Plain, PlainMap } from "./plain.ts";
import { plainFloat, show } from "./plain.ts";

const UTF8 = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });

/**
 * Read exactly one value; binary fields are views of `data`.
 *
 * @param maxValues Most values, keys, maps and arrays counted.
 * @throws DecodeError `malformed`, with the byte: cut off, nested or counted beyond the limits, a token that no message
 * uses, a key that is no text or stands twice, text that is no UTF-8, bytes after the end.
 */
export function readMsgpack(data: Uint8Array, maxValues: number = Number.POSITIVE_INFINITY): Plain {
  const reader = new Reader(data, maxValues);
  const value = reader.value(0);
  reader.expectEnd();
  return value;
}

class Reader {
  readonly #data: Uint8Array;
  readonly #view: DataView;
  readonly #maxValues: number;
  #values = 0;
  #at = 0;

  constructor(data: Uint8Array, maxValues: number) {
    this.#maxValues = maxValues;
    this.#data = data;
    this.#view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  }

  expectEnd(): void {
    const remainingBytes = this.#data.length - this.#at;
    if (remainingBytes > 0) throw malformed(`got ${remainingBytes} bytes after the message, expected none`, this.#at);
  }

  /** `depth` counts the maps and arrays around the value. */
  value(depth: number): Plain {
    const start = this.#at;
    this.#values += 1;
    if (this.#values > this.#maxValues) throw malformed(`got over ${this.#maxValues} values, expected fewer`, start);
    const token = this.#view.getUint8(this.#take(1));
    if (token <= 0x7f) return token;
    if (token >= 0xe0) return token - 0x100;
    if (token <= 0x8f) return this.#map(token & 0x0f, depth, start);
    if (token <= 0x9f) return this.#array(token & 0x0f, depth, start);
    if (token <= 0xbf) return this.#text(token & 0x1f);
    // The tokens of the msgpack specification, but for extensions, which no message uses. Containers are bounded in items
    // and depth before any of them is read (`expectContainer`): a stated length reserves nothing.
    switch (token) {
      case 0xc0:
        return null;
      case 0xc2:
        return false;
      case 0xc3:
        return true;
      case 0xc4:
        return this.#binary(this.#count(1));
      case 0xc5:
        return this.#binary(this.#count(2));
      case 0xc6:
        return this.#binary(this.#count(4));
      case 0xca:
        return plainFloat(this.#view.getFloat32(this.#take(4)));
      case 0xcb:
        return plainFloat(this.#view.getFloat64(this.#take(8)));
      case 0xcc:
        return this.#count(1);
      case 0xcd:
        return this.#count(2);
      case 0xce:
        return this.#count(4);
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
        return this.#text(this.#count(1));
      case 0xda:
        return this.#text(this.#count(2));
      case 0xdb:
        return this.#text(this.#count(4));
      case 0xdc:
        return this.#array(this.#count(2), depth, start);
      case 0xdd:
        return this.#array(this.#count(4), depth, start);
      case 0xde:
        return this.#map(this.#count(2), depth, start);
      case 0xdf:
        return this.#map(this.#count(4), depth, start);
      default:
        throw malformed(`got msgpack token 0x${token.toString(16)}, which no message uses`, start);
    }
  }

  /** Move on by so many bytes, which must be there; returns where they start. */
  #take(length: number): number {
    const start = this.#at;
    if (length > this.#data.length - start) {
      throw malformed(`got ${this.#data.length - start} bytes, expected ${length} of a value`, start);
    }
    this.#at = start + length;
    return start;
  }

  #count(width: 1 | 2 | 4): number {
    const start = this.#take(width);
    if (width === 1) return this.#view.getUint8(start);
    return width === 2 ? this.#view.getUint16(start) : this.#view.getUint32(start);
  }

  #binary(length: number): Uint8Array {
    const start = this.#take(length);
    return this.#data.subarray(start, this.#at);
  }

  #text(length: number): string {
    const start = this.#at;
    try {
      return UTF8.decode(this.#binary(length));
    } catch (error) {
      if (error instanceof DecodeError) throw error;
      throw malformed("got text that is not UTF-8", start);
    }
  }

  #array(count: number, depth: number, start: number): Plain[] {
    expectContainer(count, depth, start);
    const values: Plain[] = [];
    for (let number = 0; number < count; number += 1) values.push(this.value(depth + 1));
    return values;
  }

  #map(count: number, depth: number, start: number): PlainMap {
    expectContainer(count, depth, start);
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
}

function expectContainer(count: number, depth: number, start: number): void {
  if (count > LIMITS.MAX_CONTAINER_ITEMS) {
    throw malformed(`got ${count} items, expected at most ${LIMITS.MAX_CONTAINER_ITEMS}`, start);
  }
  if (depth + 1 > LIMITS.MAX_DEPTH) throw malformed(`got nesting beyond ${LIMITS.MAX_DEPTH} levels`, start);
}

/** An integer of 64 bits: a number where that is exact. */
function exact(value: bigint): number | bigint {
  const number = Number(value);
  return Number.isSafeInteger(number) ? number : value;
}

function malformed(text: string, offset: number): DecodeError {
  return new DecodeError("malformed", text, { offset });
}
