/** Values between bytes and fields: what msgpack holds, before any table has looked at it. */

/**
 * A float whose value is whole. As a plain number it would look like an integer, and the protocol tells the two apart:
 * a generation of 7.0 is refused, a radius of 60.0 is not.
 */
export class WholeFloat {
  readonly value: number;

  constructor(value: number) {
    this.value = value;
  }
}

/** A map with text keys, each once, in the order received. */
export type PlainMap = Map<string, Plain>;

/**
 * A value as received or to be sent. A `number` is an integer where it is whole, else a float; integers beyond 2^53-1 are
 * `bigint`; binary is a view of the message.
 */
export type Plain = null | boolean | string | number | bigint | WholeFloat | Uint8Array | Plain[] | PlainMap;

/** A float as a plain value, whole or not. */
export function plainFloat(value: number): number | WholeFloat {
  return Number.isInteger(value) ? new WholeFloat(value) : value;
}

/** Show a value in an error text, never more than a few dozen characters of it. */
export function show(value: unknown): string {
  if (value === null || value === undefined) return "nothing";
  if (typeof value === "string")
    return value.length > 48 ? `"${value.slice(0, 48)}"... (${value.length} long)` : `"${value}"`;
  if (typeof value === "bigint") return "an integer beyond 2^53";
  if (value instanceof WholeFloat) return `${value.value}.0`;
  if (value instanceof Uint8Array) return `${value.length} bytes of binary`;
  if (value instanceof Map) return `a map of ${value.size}`;
  if (Array.isArray(value)) return `a list of ${value.length}`;
  return typeof value === "object" ? "an object" : String(value);
}
