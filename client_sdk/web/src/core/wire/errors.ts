/** Errors of the wire, and what a client makes of a close code (wire protocol, section 11). */

import type { ErrorCode } from "./messages.generated.ts";
import { CLOSE_CODES } from "./messages.generated.ts";

/** Where and in which message a field was refused. */
export interface RefusedField {
  readonly messageType: string;
  /** Path of the field, for example `budgets.max_bytes`. */
  readonly field: string;
  readonly generation?: number;
  readonly request?: number;
}

/**
 * What the peer sent is not allowed.
 *
 * `malformed`: bytes or text that are no message and no frame. `too_large`: beyond the limit of its direction.
 * `invalid_field`: a known message with a field that is missing, mistyped or out of range.
 */
export class DecodeError extends Error {
  override readonly name = "DecodeError";
  readonly code: "malformed" | "too_large" | "invalid_field";
  /** False for messages that change nothing by being refused; else the connection cannot go on. */
  readonly fatal: boolean;
  /** Byte (JSON: character) in the received message, where one is known. */
  readonly offset: number | undefined;
  readonly messageType: string | undefined;
  readonly field: string | undefined;
  readonly generation: number | undefined;
  readonly request: number | undefined;

  /** `text` says what was received and what was expected. */
  constructor(code: DecodeError["code"], text: string, details: { offset?: number; refused?: RefusedField } = {}) {
    super(details.offset === undefined ? text : `${text} (at byte ${details.offset})`);
    this.code = code;
    this.offset = details.offset;
    this.messageType = details.refused?.messageType;
    this.field = details.refused?.field;
    this.generation = details.refused?.generation;
    this.request = details.refused?.request;
    this.fatal = details.refused === undefined || !NOT_FATAL.has(details.refused.messageType);
  }
}

/** Our own side tried to send a message that is not allowed. */
export class InvalidMessageError extends Error {
  override readonly name = "InvalidMessageError";
  readonly messageType: string;
  readonly field: string;

  constructor(messageType: string, field: string, text: string) {
    super(`${messageType}.${field}: ${text}`);
    this.messageType = messageType;
    this.field = field;
  }
}

/** Messages that are refused alone: they changed nothing, so the session goes on. */
const NOT_FATAL: ReadonlySet<string> = new Set(["aim", "land", "pick", "join", "gather"]);

/** What a client does after a close: nothing, connect again, ask for another token, or stop. */
export type AfterClose = "done" | "again" | "token" | "stop";

const AFTER_CLOSE: ReadonlyMap<number, AfterClose> = new Map([
  [1000, "done"],
  [CLOSE_CODES.malformed, "stop"],
  [CLOSE_CODES.unauthorised, "token"],
  [CLOSE_CODES.forbidden, "stop"],
  [CLOSE_CODES.unknown_scene, "stop"],
  [CLOSE_CODES.unsupported_version, "stop"],
  [CLOSE_CODES.too_large, "stop"],
]);

/** What a client does after a connection was closed with this code; every other one may pass, so `again`. */
export function afterClose(closeCode: number): AfterClose {
  return AFTER_CLOSE.get(closeCode) ?? "again";
}

/** The error code that a close code stands for, where a close came without an `error` message; else `"closed"`. */
export function codeOfClose(closeCode: number): ErrorCode | "closed" {
  for (const [code, close] of Object.entries(CLOSE_CODES)) {
    if (close === closeCode) return code as ErrorCode;
  }
  return "closed";
}
