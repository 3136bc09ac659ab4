/** Values out of a parsed JSON document, each checked for what it is before it is used. */

import { PayloadError } from "../payload/errors.ts";

/** A JSON object; what its keys hold is not known. */
export type JsonObject = Readonly<Record<string, unknown>>;

/** Far above any segment: a bound for arithmetic. 134 M rows of 16 bytes. */
const MAX_WHOLE = 2 ** 31;

/** The value, if it is an object. */
export function expectObject(value: unknown, label: string): JsonObject {
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as JsonObject;
  throw new PayloadError(`${label} is ${kindOf(value)}, expected an object`);
}

/** The value, if it is an object or absent. */
export function optionalObject(value: unknown, label: string): JsonObject {
  return value === undefined ? {} : expectObject(value, label);
}

/** The value, if it is a list. */
export function expectList(value: unknown, label: string): readonly unknown[] {
  if (Array.isArray(value)) return value;
  throw new PayloadError(`${label} is ${kindOf(value)}, expected a list`);
}

/** The one entry of the list under `key`. */
export function onlyOne(owner: JsonObject, key: string): JsonObject {
  const values = expectList(owner[key], key);
  if (values.length !== 1) throw new PayloadError(`${values.length} ${key}, expected 1`);
  return expectObject(values[0], key);
}

/** The object with that number in a list. */
export function pick(values: readonly unknown[], number: unknown, label: string): JsonObject {
  if (typeof number === "number" && Number.isInteger(number) && number >= 0 && number < values.length) {
    return expectObject(values[number], label);
  }
  throw new PayloadError(`${label} is ${shortly(number)}, expected 0 to ${values.length - 1}`);
}

/** A whole number of at least `least`. */
export function expectWhole(value: unknown, label: string, minimum: number): number {
  if (typeof value === "number" && Number.isInteger(value) && value >= minimum && value <= MAX_WHOLE) return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected a whole number from ${minimum} to ${MAX_WHOLE}`);
}

/** A finite number. */
export function expectNumber(value: unknown, label: string): number {
  if (typeof value === "number" && Number.isFinite(value)) return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected a finite number`);
}

/** Three finite numbers. */
export function expectTriple(value: unknown, label: string): [number, number, number] {
  const values = expectList(value, label);
  if (values.length !== 3) throw new PayloadError(`${label} has ${values.length} numbers, expected 3`);
  return [expectNumber(values[0], label), expectNumber(values[1], label), expectNumber(values[2], label)];
}

/** Show a value in an error text, a few dozen characters of it at most. */
export function shortly(value: unknown): string {
  return typeof value === "number" || typeof value === "string" || typeof value === "boolean"
    ? JSON.stringify(value).slice(0, 48)
    : kindOf(value);
}

function kindOf(value: unknown): string {
  if (value === undefined) return "missing";
  if (value === null) return "null";
  return Array.isArray(value) ? "a list" : `of type ${typeof value}`;
}
