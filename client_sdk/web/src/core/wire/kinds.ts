/**
 * What a field of a message may be: the vocabulary of the generated tables.
 *
 * The tables (messages.generated.ts) are written from the Python classes; reading, checking and writing by them is in
 * fields.ts and packed.ts.
 */

/** A protocol version: major, minor. */
export type Version = readonly [number, number];

/** One held segment with its hash: a row of a held table. */
export interface HeldRow {
  readonly segment: number;
  /** XXH3-64 of the payload. */
  readonly xxh3: bigint;
}

/** What a field holds. */
export type Kind =
  | { readonly name: "integer"; readonly low: number; readonly high: number }
  | { readonly name: "number"; readonly low: number; readonly high: number; readonly lowExcluded: boolean }
  | { readonly name: "flag" }
  /** Lengths count Unicode code points; the pattern is met in full. */
  | { readonly name: "text"; readonly shortest: number; readonly longest: number; readonly pattern: string | null }
  | { readonly name: "choice"; readonly options: readonly string[] }
  | { readonly name: "position"; readonly bound: number; readonly nonzero: boolean }
  | { readonly name: "version" }
  | { readonly name: "versions"; readonly most: number }
  | { readonly name: "numbers"; readonly most: number }
  | PackedKind
  | { readonly name: "part"; readonly part: string }
  | { readonly name: "parts"; readonly part: string; readonly most: number };

/** A kind that is one binary field of little-endian rows. */
export type PackedKind = { readonly name: "ids" | "held" | "load"; readonly most: number };

/** One field: its name on the wire and here, and what it holds. */
export interface Field {
  readonly name: string;
  readonly required: boolean;
  readonly kind: Kind;
}

/** The fields of a message or part, in the order of writing. */
export type FieldTable = readonly Field[];

/** Who sends a message. */
export type Direction = "client_to_server" | "server_to_client";

/** Fields of every message, by direction and type. */
export type MessageTable = Readonly<Record<Direction, Readonly<Record<string, FieldTable>>>>;
