/** Errors of the wire, and what a client does after a close code (protocol, section 9). */

/** Bytes from the server that the protocol does not allow; the connection cannot go on. */
export class DecodeError extends Error {
  override readonly name = "DecodeError";
  /** `malformed`: not a message or frame. `too_large`: above a limit. `invalid_field`: a field is missing or out of range. */
  readonly code: "malformed" | "too_large" | "invalid_field";

  /** @param text - what was received and what was expected. */
  constructor(code: DecodeError["code"], text: string) {
    super(text);
    this.code = code;
  }
}

/** The close code of each error code where it is fatal. */
export const CLOSE_CODES = {
  malformed: 4400,
  invalid_field: 4400,
  out_of_order: 4400,
  radius_too_large: 4400,
  unauthorised: 4401,
  forbidden: 4403,
  group_refused: 4403,
  unknown_scene: 4404,
  timeout: 4408,
  unsupported_version: 4409,
  too_large: 4413,
  too_many: 4429,
  internal: 4500,
  draining: 4503,
} as const;

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

/** What a client does after a connection was closed with this code. Any other close may be temporary: `again`. */
export function afterClose(closeCode: number): AfterClose {
  return AFTER_CLOSE.get(closeCode) ?? "again";
}

/** The error code of a close code, for a close without an `error` message; else `"closed"`. */
export function codeOfClose(closeCode: number): string {
  return Object.entries(CLOSE_CODES).find(([, close]) => close === closeCode)?.[0] ?? "closed";
}
