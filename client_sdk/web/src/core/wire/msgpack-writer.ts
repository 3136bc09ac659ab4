/** Plain values as msgpack: every integer in its shortest form, every float in 64 bits, as the Python side writes them. */

import type { Plain } from "./plain.ts";
import { WholeFloat } from "./plain.ts";

const UTF8 = new TextEncoder();

/** Write one value. */
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
    if (value === null) this.#byte(0xc0);
    else if (typeof value === "boolean") this.#byte(value ? 0xc3 : 0xc2);
    else if (typeof value === "string") this.#text(value);
    else if (typeof value === "bigint") this.#long(value);
    else if (typeof value === "number") Number.isInteger(value) ? this.#integer(value) : this.#float(value);
    else if (value instanceof WholeFloat) this.#float(value.value);
    else if (value instanceof Uint8Array) this.#binary(value);
    else if (Array.isArray(value)) {
      this.#head(value.length, 0x90, 15, null, 0xdc);
      for (const item of value) this.value(item);
    } else {
      this.#head(value.size, 0x80, 15, null, 0xde);
      for (const [key, item] of value) {
        this.#text(key);
        this.value(item);
      }
    }
  }

  /** Room for so many more bytes; returns where they start. */
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

  #byte(value: number): void {
    const at = this.#grow(1);
    this.#view.setUint8(at, value);
  }

  #float(value: number): void {
    this.#byte(0xcb);
    const at = this.#grow(8);
    this.#view.setFloat64(at, value);
  }

  #integer(value: number): void {
    if (value >= 0) {
      if (value <= 0x7f) this.#byte(value);
      else if (value <= 0xff) this.#sized(0xcc, 1, value);
      else if (value <= 0xffff) this.#sized(0xcd, 2, value);
      else if (value <= 0xffffffff) this.#sized(0xce, 4, value);
      else this.#long(BigInt(value));
    } else if (value >= -0x20) this.#byte(0x100 + value);
    else if (value >= -0x80) this.#sized(0xd0, 1, value);
    else if (value >= -0x8000) this.#sized(0xd1, 2, value);
    else if (value >= -0x80000000) this.#sized(0xd2, 4, value);
    else this.#long(BigInt(value));
  }

  #long(value: bigint): void {
    this.#byte(value < 0n ? 0xd3 : 0xcf);
    const at = this.#grow(8);
    this.#view.setBigUint64(at, BigInt.asUintN(64, value));
  }

  /** A token and a number behind it. */
  #sized(token: number, width: 1 | 2 | 4, value: number): void {
    this.#byte(token);
    const at = this.#grow(width);
    if (width === 1) this.#view.setUint8(at, value);
    else if (width === 2) this.#view.setUint16(at, value);
    else this.#view.setUint32(at, value);
  }

  /** A token with its count: in the token itself up to `inToken`, else in 8 (where there is such a form), 16, 32 bits. */
  #head(count: number, short: number, inToken: number, token8: number | null, token16: number): void {
    if (count <= inToken) this.#byte(short | count);
    else if (token8 !== null && count <= 0xff) this.#sized(token8, 1, count);
    else if (count <= 0xffff) this.#sized(token16, 2, count);
    else this.#sized(token16 + 1, 4, count);
  }

  #text(text: string): void {
    const bytes = UTF8.encode(text);
    this.#head(bytes.length, 0xa0, 31, 0xd9, 0xda);
    const at = this.#grow(bytes.length);
    this.#data.set(bytes, at);
  }

  #binary(bytes: Uint8Array): void {
    this.#head(bytes.length, 0, -1, 0xc4, 0xc5);
    const at = this.#grow(bytes.length);
    this.#data.set(bytes, at);
  }
}
