/** Messages to bytes, and back (wire protocol, section 3). */

import type { RefusedField } from "./errors.ts";
import { DecodeError, InvalidMessageError } from "./errors.ts";
import { checkFields, readFields, writeFields } from "./fields.ts";
import type { Direction, FieldTable } from "./kinds.ts";
import type { ClientMessage, ServerMessage } from "./messages.generated.ts";
import { LIMITS, MESSAGES } from "./messages.generated.ts";
import { readMsgpack } from "./msgpack-reader.ts";
import { writeMsgpack } from "./msgpack-writer.ts";
import type { Plain, PlainMap } from "./plain.ts";
import { show } from "./plain.ts";
import { Refused } from "./refused.ts";
import { checkRules } from "./rules.ts";

/** A message of a type that this version does not know in that direction: skip it. */
export interface UnknownMessage {
  readonly type: "unknown";
  /** Its type, at most 64 characters of it. */
  readonly name: string;
}

/** Everything that one side sends. */
export type MessageOf<D extends Direction> = D extends "client_to_server" ? ClientMessage : ServerMessage;

const MAX_MESSAGE_BYTES: Readonly<Record<Direction, number>> = {
  client_to_server: LIMITS.MAX_CLIENT_MESSAGE_BYTES,
  server_to_client: LIMITS.MAX_SERVER_MESSAGE_BYTES,
};
/** The values of a server's message are bounded by its bytes. */
const MAX_MESSAGE_VALUES: Readonly<Record<Direction, number>> = {
  client_to_server: LIMITS.MAX_CLIENT_VALUES,
  server_to_client: Number.POSITIVE_INFINITY,
};
const LONGEST_TYPE = 64;

/**
 * Write a message as bytes. Keys stand in the order of the tables, `type` first; absent fields are left out; the same
 * message gives the same bytes every time.
 *
 * @throws InvalidMessageError If a field is not what the protocol allows.
 */
export function encodeMessage(message: ClientMessage | ServerMessage): Uint8Array<ArrayBuffer> {
  const type: string = message.type;
  const table = tableOf("client_to_server", type) ?? tableOf("server_to_client", type);
  if (table === undefined) throw new InvalidMessageError(type, "type", "expected a message of the protocol");
  try {
    const values = checkFields(table, { ...message });
    checkRules(type, values);
    const plain: PlainMap = new Map<string, Plain>([["type", type]]);
    writeFields(table, values, plain);
    return writeMsgpack(plain);
  } catch (error) {
    if (error instanceof Refused) throw new InvalidMessageError(type, error.path, error.message);
    throw error;
  }
}

/**
 * Read the message that bytes hold; unknown keys are skipped.
 *
 * @param data One whole WebSocket message: binary; a text message is malformed.
 * @param direction Who sent it.
 * @param maxBytes A stricter limit than the protocol's own for this direction.
 * @throws DecodeError If it is no message, too long, or has a field that is missing, mistyped or out of range.
 */
export function decodeMessage<D extends Direction>(
  data: Uint8Array | string,
  direction: D,
  maxBytes: number = Number.POSITIVE_INFINITY,
): MessageOf<D> | UnknownMessage {
  const limit = Math.min(maxBytes, MAX_MESSAGE_BYTES[direction]);
  if (typeof data === "string") throw malformed("got a text message, expected a binary one");
  if (data.length > limit) {
    throw new DecodeError("too_large", `got a message of ${data.length} bytes, expected at most ${limit}`);
  }
  const plain = readMsgpack(data, MAX_MESSAGE_VALUES[direction]);
  if (!(plain instanceof Map)) throw malformed(`got ${show(plain)}, expected a map with a type`);
  const type = plain.get("type");
  if (typeof type !== "string") throw malformed(`got type ${show(type)}, expected text`);
  const table = tableOf(direction, type);
  if (table === undefined) return { type: "unknown", name: [...type].slice(0, LONGEST_TYPE).join("") };
  try {
    const values = readFields(table, plain);
    checkRules(type, values);
    // The table is generated from the same classes as the type.
    return { type, ...values } as unknown as MessageOf<D>;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    const refused = refusedField(type, error.path, table, plain);
    throw new DecodeError("invalid_field", `${type}.${error.path}: ${error.message}`, { refused });
  }
}

/** The subprotocol entry that carries a token where no header can be set (section 2.3). */
export function tokenSubprotocol(token: string): string {
  const text = btoa(String.fromCharCode(...new TextEncoder().encode(token)));
  return `terraport.token.${text.replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "")}`;
}

function tableOf(direction: Direction, type: string): FieldTable | undefined {
  // A type may be called like a method that every object has.
  return Object.hasOwn(MESSAGES[direction], type) ? MESSAGES[direction][type] : undefined;
}

function refusedField(messageType: string, field: string, table: FieldTable, plain: PlainMap): RefusedField {
  const generation = readable("generation", table, plain);
  const request = readable("request", table, plain);
  return {
    messageType,
    field,
    ...(generation !== undefined && { generation }),
    ...(request !== undefined && { request }),
  };
}

/** A refused message's number for the answer, where it has one that is in range. */
function readable(name: string, table: FieldTable, plain: PlainMap): number | undefined {
  if (!table.some((field) => field.name === name)) return undefined;
  const value = plain.get(name);
  return typeof value === "number" && Number.isInteger(value) && value >= 0 && value <= 0xffffffff ? value : undefined;
}

function malformed(text: string): DecodeError {
  return new DecodeError("malformed", text);
}
