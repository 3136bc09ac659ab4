/** The server broke the wire protocol; the connection cannot be used any further. */
export class ProtocolViolation extends Error {
  override readonly name = "ProtocolViolation";
}
