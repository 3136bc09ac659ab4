/** Kinds of fields: how a value of a message is read from msgpack, and written. */

import { type Plain, type PlainMap, show, WholeFloat } from "./msgpack.ts";

/** A value that a field does not allow; `path` names the field within its part, where it is in one. */
export class FieldError extends Error {
  readonly path: string;

  constructor(text: string, path = "") {
    super(text);
    this.path = path;
  }
}

/** A kind of field. Both functions throw FieldError. */
export interface Kind<T> {
  read(value: Plain): T;
  write(value: T): Plain;
  readonly isOptional?: boolean | undefined;
}

/** Fields of a message or part, by name, in the order in which they are written. */
export type Fields = Readonly<Record<string, Kind<unknown>>>;

type ValueOf<K> = K extends { read(value: Plain): infer T } ? T : never;
type OptionalNames<F> = { [N in keyof F]: F[N] extends { isOptional: true } ? N : never }[keyof F];

/** The values of fields. */
export type ValuesOf<F> = { readonly [N in Exclude<keyof F, OptionalNames<F>>]: ValueOf<F[N]> } & {
  readonly [N in OptionalNames<F>]?: ValueOf<F[N]> | undefined;
};

/**
 * Names a payload by its content: 16 lower-case hexadecimal digits. Equal keys, equal bytes, in any version of any scene.
 */
export type SegmentKey = string;

export function optional<T>(kind: Kind<T>): Kind<T> & { readonly isOptional: true } {
  return { ...kind, isOptional: true };
}

export function integer(low: number, high: number): Kind<number> {
  return checked((value) => {
    if (typeof value === "number" && Number.isInteger(value) && value >= low && value <= high) return value;
    throw new FieldError(`got ${show(value)}, expected an integer from ${low} to ${high}`);
  });
}

/** A finite number from `low` to `high`; above `low` with `isAbove`. */
export function number(low: number, high: number, isAbove = false): Kind<number> {
  return checked((value) => {
    const actual = value instanceof WholeFloat ? value.value : value;
    if (typeof actual === "number" && actual <= high && (isAbove ? actual > low : actual >= low)) return actual;
    throw new FieldError(`got ${show(value)}, expected a number ${isAbove ? "above" : "from"} ${low} to ${high}`);
  });
}

export const FLAG: Kind<boolean> = checked((value) => {
  if (typeof value === "boolean") return value;
  throw new FieldError(`got ${show(value)}, expected true or false`);
});

/** Text of so many code points. */
export function text(longest: number, shortest = 0, pattern?: RegExp): Kind<string> {
  return checked((value) => {
    if (typeof value === "string" && (pattern?.test(value) ?? true) && !/\p{Cs}/u.test(value)) {
      const length = [...value].length;
      if (length >= shortest && length <= longest) return value;
    }
    const form = pattern === undefined ? "" : ` like ${pattern.source}`;
    throw new FieldError(`got ${show(value)}, expected text of ${shortest} to ${longest} characters${form}`);
  });
}

export function choice<const T extends string>(...options: readonly T[]): Kind<T> {
  return checked((value) => {
    const found = options.find((option) => option === value);
    if (found !== undefined) return found;
    throw new FieldError(`got ${show(value)}, expected ${options.join(" or ")}`);
  });
}

/** Three numbers, each of at most this magnitude. */
export function triple(largest: number): Kind<readonly [number, number, number]> {
  const coordinate = number(-largest, largest);
  return {
    read(value) {
      if (!Array.isArray(value) || value.length !== 3) throw new FieldError(`got ${show(value)}, expected 3 numbers`);
      return [coordinate.read(value[0]!), coordinate.read(value[1]!), coordinate.read(value[2]!)];
    },
    write: (value) => [coordinate.write(value[0]), coordinate.write(value[1]), coordinate.write(value[2])],
  };
}

/** A map from names to finite numbers. */
export function numberMap(most: number): Kind<Readonly<Record<string, number>>> {
  const name = text(128, 1);
  const item = number(-Number.MAX_VALUE, Number.MAX_VALUE);
  return {
    read(value) {
      if (!(value instanceof Map) || value.size > most) throw new FieldError(`got ${show(value)}, expected a map`);
      return Object.fromEntries([...value].map(([key, one]) => [name.read(key), item.read(one)]));
    },
    write: (value) => new Map(Object.entries(value)),
  };
}

/** Binary of rows of `width` bytes, at most `most` of them, little-endian. */
export function rows<T>(
  width: number,
  most: number,
  readRow: (view: DataView, at: number) => T,
  writeRow: (view: DataView, at: number, row: T) => void,
): Kind<readonly T[]> {
  return {
    read(value) {
      if (!(value instanceof Uint8Array) || value.length % width !== 0 || value.length > most * width) {
        throw new FieldError(`got ${show(value)}, expected binary of at most ${most} rows of ${width} bytes`);
      }
      const view = new DataView(value.buffer, value.byteOffset, value.byteLength);
      return Array.from({ length: value.length / width }, (_, row) => readRow(view, row * width));
    },
    write(value) {
      if (value.length > most) throw new FieldError(`got ${value.length} rows, expected at most ${most}`);
      const bytes = new Uint8Array(value.length * width);
      const view = new DataView(bytes.buffer);
      value.forEach((row, at) => {
        writeRow(view, at * width, row);
      });
      return bytes;
    },
  };
}

export function keys(most: number): Kind<readonly SegmentKey[]> {
  return rows(8, most, readKey, (view, at, key) => view.setBigUint64(at, BigInt(`0x${key}`), true));
}

export function readKey(view: DataView, at: number): SegmentKey {
  return view.getBigUint64(at, true).toString(16).padStart(16, "0");
}

export const BINARY: Kind<Uint8Array<ArrayBuffer>> = checked((value) => {
  // A copy: the message's buffer must not be kept by it.
  if (value instanceof Uint8Array) return value.slice();
  throw new FieldError(`got ${show(value)}, expected binary`);
});

export function part<const F extends Fields>(fields: F): Kind<ValuesOf<F>> {
  return {
    read(value) {
      if (value instanceof Map) return readFields(fields, value);
      throw new FieldError(`got ${show(value)}, expected a map`);
    },
    write: (value) => writeFields(fields, value),
  };
}

export function list<T>(kind: Kind<T>, most: number): Kind<readonly T[]> {
  return {
    read(value) {
      if (Array.isArray(value) && value.length <= most) return value.map((item) => kind.read(item));
      throw new FieldError(`got ${show(value)}, expected a list of at most ${most}`);
    },
    write: (value) => value.map((item) => kind.write(item)),
  };
}

/** Read the fields of a map; keys that are not known are skipped. */
export function readFields<F extends Fields>(fields: F, map: PlainMap): ValuesOf<F> {
  const values: Record<string, unknown> = {};
  for (const [name, kind] of Object.entries(fields)) {
    const value = map.get(name);
    if (value == null && kind.isOptional === true) continue;
    values[name] = inField(name, () => kind.read(value ?? null));
  }
  return values as ValuesOf<F>;
}

/** Write fields that are given, in the order of the table. */
export function writeFields<F extends Fields>(fields: F, values: ValuesOf<F>, into: PlainMap = new Map()): PlainMap {
  for (const [name, kind] of Object.entries(fields)) {
    const value = (values as Readonly<Record<string, unknown>>)[name];
    if (value === undefined && kind.isOptional === true) continue;
    into.set(
      name,
      inField(name, () => kind.write(value)),
    );
  }
  return into;
}

/** A kind whose values are the same in msgpack and here. */
function checked<T extends Plain>(check: (value: Plain) => T): Kind<T> {
  return { read: check, write: check };
}

function inField<T>(name: string, act: () => T): T {
  try {
    return act();
  } catch (error) {
    if (!(error instanceof FieldError)) throw error;
    throw new FieldError(error.message, error.path === "" ? name : `${name}.${error.path}`);
  }
}
