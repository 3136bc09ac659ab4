/** Planes of bits and of differences (spec/segment-format.md). */

import { PayloadError } from "./errors.ts";

/** The planes of a stream, one after the other. */
export class Planes {
  readonly #stream: Uint8Array;
  #at: number;

  /** @param at Where the first of them begins. */
  constructor(stream: Uint8Array, at: number) {
    this.#stream = stream;
    this.#at = at;
  }

  /** Bytes that were not taken. */
  get left(): number {
    return this.#stream.length - this.#at;
  }

  /** Take a plane of bits; see {@link isSet}. */
  bits(count: number): Uint8Array {
    const bytes = Math.ceil(count / 8);
    if (bytes > this.left) throw new PayloadError(`${count} bits, expected at most ${this.left} bytes`);
    this.#at += bytes;
    return this.#stream.subarray(this.#at - bytes, this.#at);
  }

  /** Pass over so many bytes, which must be there. */
  skip(bytes: number): void {
    this.#at += bytes;
  }

  /** Take a plane of differences into every `stride`-th entry from `first` on. The bytes must be there. */
  differences<T extends Uint8Array | Uint16Array | Uint32Array>(target: T, width: 1 | 2 | 4, first = 0, stride = 1): T {
    const stream = this.#stream;
    const count = target.length / stride;
    const at = this.#at;
    for (let row = 0, value = 0; row < count; row += 1) {
      let zigzag = stream[at + row]!;
      if (width > 1) zigzag |= stream[at + count + row]! << 8;
      if (width > 2) zigzag |= (stream[at + 2 * count + row]! << 16) | (stream[at + 3 * count + row]! << 24);
      value = (value + ((zigzag >>> 1) ^ -(zigzag & 1))) | 0;
      target[first + row * stride] = value; // Modulo 2^(8 width), as the array's entries are.
    }
    this.#at += width * count;
    return target;
  }
}

/** 1 or 0. */
export function isSet(bits: Uint8Array, at: number): number {
  return (bits[at >>> 3]! >>> (at & 7)) & 1;
}

/** How many of the first `count` bits are 1. */
export function countBits(bits: Uint8Array, count: number): number {
  let sum = 0;
  for (let at = 0; at < count; at += 1) sum += isSet(bits, at);
  return sum;
}

/** How many bits of a 32-bit number are 1. */
export function countOnes(value: number): number {
  let ones = 0;
  for (let rest = value; rest !== 0; rest &= rest - 1) ones += 1;
  return ones;
}
