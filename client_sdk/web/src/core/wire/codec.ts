/** Messages to bytes or text, and back (wire protocol, section 3). */

import type { Direction } from "./kinds.ts";
import type { ClientMessage, ServerMessage, SUBPROTOCOLS } from "./messages.generated.ts";

/** WebSocket subprotocol of a connection. */
export type Subprotocol = (typeof SUBPROTOCOLS)[number];

/** A message of a type that this version does not know in that direction: skip it. */
export interface UnknownMessage {
  readonly type: "unknown";
  /** Its type, at most 64 characters of it. */
  readonly name: string;
}

/** Everything that one side sends. */
export type MessageOf<D extends Direction> = D extends "client_to_server" ? ClientMessage : ServerMessage;

/**
 * Write a message as bytes (msgpack) or text (JSON). Keys stand in the order of the tables, `type` first; absent fields
 * are left out; the same message gives the same bytes every time.
 *
 * @throws InvalidMessageError If a field is not what the protocol allows.
 */
export function encodeMessage(
  _message: ClientMessage | ServerMessage,
  _subprotocol: Subprotocol,
): Uint8Array<ArrayBuffer> | string {
  throw new Error("on its way");
}

/**
 * Read the message that bytes (msgpack) or text (JSON) hold; unknown keys are skipped.
 *
 * @param direction Who sent it.
 * @param maxBytes A stricter limit than the protocol's own for this direction.
 * @throws DecodeError If it is no message, too long, or has a field that is missing, mistyped or out of range.
 */
export function decodeMessage<D extends Direction>(
  _data: Uint8Array | string,
  _subprotocol: Subprotocol,
  _direction: D,
  _maxBytes?: number,
): MessageOf<D> | UnknownMessage {
  throw new Error("on its way");
}

/** The subprotocol entry that carries a token where no header can be set (section 2.3). */
export function tokenSubprotocol(token: string): string {
  const text = btoa(String.fromCharCode(...new TextEncoder().encode(token)));
  return `terraport.token.${text.replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "")}`;
}
