/**
 * Fields by their tables: read, checked, written.
 *
 * A message is read in three passes, as the Python side does it, so that both name the same field of a message with
 * several faults: layout of every field, value of every field, rules between fields.
 */

import type { Field, FieldTable, Kind } from "./kinds.ts";
import { PARTS } from "./messages.generated.ts";
import type { PackedRows } from "./packed.ts";
import { checkRows, readRows, writeRows } from "./packed.ts";
import type { Plain, PlainMap } from "./plain.ts";
import { plainFloat, show, WholeFloat } from "./plain.ts";
import { below, Refused } from "./refused.ts";

/** Fields of a message or part by name; absent ones have no key. */
export type Values = Record<string, unknown>;

const SURROGATE = /\p{Surrogate}/u;
const VERSION_PART: Kind = { name: "integer", low: 0, high: 65_535 };
const ATTRIBUTE_NAME: Kind = { name: "text", shortest: 1, longest: 128, pattern: null };

/**
 * Read the fields of a map; unknown keys are skipped, null is absent.
 *
 * @throws Refused With the path of the field that is missing, mistyped or out of range.
 */
export function readFields(table: FieldTable, raw: Plain): Values {
  if (!(raw instanceof Map)) throw new Refused(`got ${show(raw)}, expected a map`);
  const values: Values = {};
  for (const { name, required, kind } of table) {
    const value = raw.get(name) ?? null;
    if (value !== null) values[name] = below(name, () => readKind(kind, value));
    else if (required) throw new Refused(`got nothing, expected ${describe(kind)}`, name);
  }
  return checkFields(table, values);
}

/**
 * Check the value of every field, and bring it to the form that the types promise.
 *
 * @throws Refused As `readFields`.
 */
export function checkFields(table: FieldTable, values: Values): Values {
  const checked: Values = {};
  for (const { name, required, kind } of table) {
    const value = values[name] ?? null;
    if (value !== null) checked[name] = below(name, () => checkKind(kind, value));
    else if (required) throw new Refused(`got nothing, expected ${describe(kind)}`, name);
  }
  return checked;
}

/** Write checked fields into a map, in the table's order. */
export function writeFields(table: FieldTable, values: Values, into: PlainMap = new Map()): PlainMap {
  for (const { name, kind } of table) {
    const value = values[name] ?? null;
    if (value !== null) into.set(name, writeKind(kind, value));
  }
  return into;
}

function readKind(kind: Kind, raw: Plain): unknown {
  switch (kind.name) {
    case "ids":
    case "held":
    case "load":
      return readRows(kind, raw);
    case "part":
      return readFields(partTable(kind.part), raw);
    case "parts": {
      const items = expectList(raw, kind.most);
      return items.map((item, number) => below(String(number), () => readFields(partTable(kind.part), item as Plain)));
    }
    case "numbers":
      if (!(raw instanceof Map)) throw new Refused(`got ${show(raw)}, expected a map of numbers`);
      // fromEntries, because a name may be `__proto__`.
      return Object.fromEntries(raw);
    default:
      return raw;
  }
}

function checkKind(kind: Kind, value: unknown): unknown {
  switch (kind.name) {
    case "integer":
      if (Number.isInteger(value) && (value as number) >= kind.low && (value as number) <= kind.high) return value;
      throw new Refused(`got ${show(value)}, expected ${describe(kind)}`);
    case "number":
      return checkNumber(kind, value);
    case "flag":
      if (typeof value === "boolean") return value;
      throw new Refused(`got ${show(value)}, expected true or false`);
    case "text":
      return checkText(kind, value);
    case "choice":
      if (typeof value === "string" && kind.options.includes(value)) return value;
      throw new Refused(`got ${show(value)}, expected one of ${kind.options.join(", ")}`);
    case "position":
      return checkPosition(kind, value);
    case "version":
      if (!Array.isArray(value) || value.length !== 2) {
        throw new Refused(`got ${show(value)}, expected a version [major, minor]`);
      }
      return value.map((number) => checkKind(VERSION_PART, number));
    case "versions":
      return expectList(value, kind.most).map((item) => checkKind({ name: "version" }, item));
    case "numbers":
      return checkNumbers(kind.most, value);
    case "ids":
    case "held":
    case "load":
      return checkRows(kind, expectList(value, kind.most) as PackedRows);
    case "part":
      return checkFields(partTable(kind.part), expectValues(value));
    case "parts":
      return expectList(value, kind.most).map((item, number) =>
        below(String(number), () => checkFields(partTable(kind.part), expectValues(item))),
      );
  }
}

function writeKind(kind: Kind, value: unknown): Plain {
  switch (kind.name) {
    case "number":
      return plainFloat(value as number);
    case "position":
      return (value as readonly number[]).map(plainFloat);
    case "numbers":
      return new Map(Object.entries(value as Record<string, number>).map(([name, size]) => [name, plainFloat(size)]));
    case "ids":
    case "held":
    case "load":
      return writeRows(value as PackedRows, kind);
    case "part":
      return writeFields(partTable(kind.part), value as Values);
    case "parts":
      return (value as readonly Values[]).map((item) => writeFields(partTable(kind.part), item));
    default:
      return value as Plain;
  }
}

function checkNumber(kind: Kind & { name: "number" }, value: unknown): number {
  const number = finite(value);
  const above = number !== null && (kind.lowExcluded ? number > kind.low : number >= kind.low);
  if (above && number <= kind.high) return number;
  throw new Refused(`got ${show(value)}, expected ${describe(kind)}`);
}

function checkText(kind: Kind & { name: "text" }, value: unknown): string {
  if (typeof value !== "string") throw new Refused(`got ${show(value)}, expected ${describe(kind)}`);
  const length = codePoints(value);
  if (length < kind.shortest || length > kind.longest) {
    throw new Refused(`got ${show(value)}, expected ${describe(kind)}`);
  }
  if (SURROGATE.test(value)) throw new Refused("got text with a lone surrogate, expected Unicode text");
  if (kind.pattern !== null && !new RegExp(`^(?:${kind.pattern})$`, "u").test(value)) {
    throw new Refused(`got ${show(value)}, expected text that matches ${kind.pattern}`);
  }
  return value;
}

function checkPosition(kind: Kind & { name: "position" }, value: unknown): readonly number[] {
  if (!Array.isArray(value) || value.length !== 3) throw new Refused(`got ${show(value)}, expected three numbers`);
  const numbers = value.map((item) => {
    const number = finite(item);
    if (number !== null && Math.abs(number) <= kind.bound) return number;
    throw new Refused(`got ${show(item)}, expected three finite numbers of size at most ${kind.bound}`);
  });
  if (kind.nonzero && numbers.every((number) => number === 0)) {
    throw new Refused("got (0, 0, 0), expected a direction");
  }
  return numbers;
}

function checkNumbers(maxCount: number, value: unknown): Readonly<Record<string, number>> {
  const pairs = Object.entries(expectValues(value));
  if (pairs.length > maxCount) throw new Refused(`got ${pairs.length} numbers, expected at most ${maxCount}`);
  return Object.fromEntries(
    pairs.map(([name, item]) => {
      checkKind(ATTRIBUTE_NAME, name);
      const number = finite(item);
      if (number === null) throw new Refused(`got ${show(item)}, expected a finite number`, name);
      return [name, number];
    }),
  );
}

/** The number, where it is finite: a float, or an integer of any size that is one as a double. */
function finite(value: unknown): number | null {
  const number = value instanceof WholeFloat ? value.value : typeof value === "bigint" ? Number(value) : value;
  return typeof number === "number" && Number.isFinite(number) ? number : null;
}

function codePoints(text: string): number {
  let count = 0;
  for (const _ of text) count += 1;
  return count;
}

function expectList(value: unknown, maxCount: number): readonly unknown[] {
  if (Array.isArray(value) && value.length <= maxCount) return value;
  throw new Refused(`got ${show(value)}, expected a list of at most ${maxCount}`);
}

function expectValues(value: unknown): Values {
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as Values;
  throw new Refused(`got ${show(value)}, expected a map`);
}

function partTable(name: string): readonly Field[] {
  const table = (PARTS as Readonly<Record<string, FieldTable>>)[name];
  if (table === undefined) throw new TypeError(`no part ${name}`);
  return table;
}

function describe(kind: Kind): string {
  switch (kind.name) {
    case "integer":
      return `an integer from ${kind.low} to ${kind.high}`;
    case "number":
      return `a number ${kind.lowExcluded ? "above" : "from"} ${kind.low} to ${kind.high}`;
    case "text":
      return `text of ${kind.shortest} to ${kind.longest} characters`;
    case "choice":
      return `one of ${kind.options.join(", ")}`;
    case "position":
      return "three numbers";
    case "part":
      return `a map (${kind.part})`;
    default:
      return kind.name;
  }
}
