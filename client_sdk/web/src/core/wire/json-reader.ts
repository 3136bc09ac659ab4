/**
 * A strict reader of one JSON value.
 *
 * `JSON.parse` hides repeated keys and whether a number was written as an integer or a float, and rounds long integers;
 * with it the two subprotocols would not refuse the same messages.
 */

import { DecodeError } from "./errors.ts";
import { LIMITS } from "./messages.generated.ts";
import type { Plain, PlainMap } from "./plain.ts";
import { plainFloat, show } from "./plain.ts";

const NUMBER = /(-?(?:0|[1-9][0-9]*))(\.[0-9]+)?([eE][-+]?[0-9]+)?/y;
const TAB = 0x09;
const LINE_FEED = 0x0a;
const CARRIAGE_RETURN = 0x0d;
const SPACE = 0x20;
const QUOTE = 0x22;
const BACKSLASH = 0x5c;
const HEX4 = /[0-9a-fA-F]{4}/y;

/** The longest integer that the Python side reads. */
const LONGEST_INTEGER = 4300;

const ESCAPES: ReadonlyMap<string, string> = new Map([
  ['"', '"'],
  ["\\", "\\"],
  ["/", "/"],
  ["b", "\b"],
  ["f", "\f"],
  ["n", "\n"],
  ["r", "\r"],
  ["t", "\t"],
]);

const WORDS: ReadonlyMap<string, Plain> = new Map<string, Plain>([
  ["true", true],
  ["false", false],
  ["null", null],
]);

/**
 * Read exactly one value.
 *
 * @throws DecodeError `malformed`, with the character: no JSON (RFC 8259), nested beyond the limit, a key that stands
 * twice, something after the end.
 */
export function readJson(text: string): Plain {
  const reader = new Reader(text);
  const value = reader.value(0);
  reader.expectEnd();
  return value;
}

class Reader {
  readonly #text: string;
  #at = 0;

  constructor(text: string) {
    this.#text = text;
  }

  expectEnd(): void {
    this.#skipBlank();
    const left = this.#text.length - this.#at;
    if (left > 0) throw this.#malformed(`got ${left} characters after the message, expected none`);
  }

  /** `depth` counts the objects and arrays around the value. */
  value(depth: number): Plain {
    this.#skipBlank();
    const first = this.#text[this.#at];
    if (first === "{") return this.#object(depth + 1);
    if (first === "[") return this.#array(depth + 1);
    if (first === '"') return this.#string();
    if (first !== undefined && (first === "-" || (first >= "0" && first <= "9"))) return this.#number();
    for (const [word, value] of WORDS) {
      if (this.#text.startsWith(word, this.#at)) {
        this.#at += word.length;
        return value;
      }
    }
    throw this.#unexpected("a value");
  }

  #number(): Plain {
    const found = this.#match(NUMBER);
    if (found === null) throw this.#unexpected("a number of JSON");
    const whole = found[0];
    if (found[2] !== undefined || found[3] !== undefined) return plainFloat(Number(whole));
    if (whole.length > LONGEST_INTEGER) throw this.#malformed("got a number that is too long");
    const value = Number(whole);
    // "-0" is the integer 0.
    return Number.isSafeInteger(value) ? value + 0 : BigInt(whole);
  }

  #object(depth: number): PlainMap {
    this.#enter(depth);
    const values: PlainMap = new Map();
    if (this.#next("}")) return values;
    for (;;) {
      this.#skipBlank();
      if (this.#text[this.#at] !== '"') throw this.#unexpected("a key in quotes");
      const key = this.#string();
      if (values.has(key)) throw this.#malformed(`got key ${show(key)} twice, expected each key once`);
      if (!this.#next(":")) throw this.#unexpected("a colon");
      values.set(key, this.value(depth));
      if (this.#next("}")) return values;
      if (!this.#next(",")) throw this.#unexpected("a comma or }");
    }
  }

  #array(depth: number): Plain[] {
    this.#enter(depth);
    const values: Plain[] = [];
    if (this.#next("]")) return values;
    for (;;) {
      values.push(this.value(depth));
      if (this.#next("]")) return values;
      if (!this.#next(",")) throw this.#unexpected("a comma or ]");
    }
  }

  #enter(depth: number): void {
    if (depth > LIMITS.MAX_DEPTH) throw this.#malformed(`got nesting beyond ${LIMITS.MAX_DEPTH} levels`);
    this.#at += 1;
  }

  #string(): string {
    this.#at += 1;
    let whole = "";
    for (;;) {
      whole += this.#run();
      const character = this.#text[this.#at];
      if (character === '"') {
        this.#at += 1;
        return whole;
      }
      if (character !== "\\") throw this.#unexpected("the end of a text");
      whole += this.#escape();
    }
  }

  /** Everything up to a quote, a backslash or a control character. */
  #run(): string {
    const start = this.#at;
    for (;;) {
      const code = this.#text.charCodeAt(this.#at);
      // Past the end it is NaN.
      if (!(code >= 0x20) || code === QUOTE || code === BACKSLASH) return this.#text.slice(start, this.#at);
      this.#at += 1;
    }
  }

  #escape(): string {
    const letter = this.#text[this.#at + 1] ?? "";
    const plain = ESCAPES.get(letter);
    if (plain === undefined && letter !== "u") throw this.#unexpected("an escape of JSON");
    this.#at += 2;
    if (plain !== undefined) return plain;
    const digits = this.#match(HEX4);
    if (digits === null) throw this.#unexpected("four hexadecimal digits");
    return String.fromCharCode(Number.parseInt(digits[0], 16));
  }

  /** Step over a character if it is the next one that is no blank. */
  #next(character: string): boolean {
    this.#skipBlank();
    if (this.#text[this.#at] !== character) return false;
    this.#at += 1;
    return true;
  }

  #skipBlank(): void {
    for (;;) {
      const code = this.#text.charCodeAt(this.#at);
      if (code !== SPACE && code !== TAB && code !== LINE_FEED && code !== CARRIAGE_RETURN) return;
      this.#at += 1;
    }
  }

  #match(pattern: RegExp): RegExpExecArray | null {
    pattern.lastIndex = this.#at;
    const found = pattern.exec(this.#text);
    if (found !== null) this.#at += found[0].length;
    return found;
  }

  #unexpected(expected: string): DecodeError {
    const character = this.#text[this.#at];
    return this.#malformed(`got ${character === undefined ? "the end" : show(character)}, expected ${expected}`);
  }

  #malformed(text: string): DecodeError {
    return new DecodeError("malformed", text, { offset: this.#at });
  }
}
