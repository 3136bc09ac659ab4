/** The error of the payload decoders. */

/** Bytes that are not a payload of the scene format; `DecodeError` of the payload. */
export class PayloadError extends Error {
  override readonly name = "PayloadError";
  /** Byte in the payload at which it was noticed, where one is known. */
  readonly offset: number | undefined;

  /** `what` says what was received and what was expected. */
  constructor(reason: string, offset?: number) {
    super(offset === undefined ? reason : `${reason} (payload offset ${offset})`);
    this.offset = offset;
  }
}
