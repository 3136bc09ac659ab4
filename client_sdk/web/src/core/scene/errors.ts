/** The error that everything which talks to a server gives to the page. */

/**
 * Something was refused, or did not come.
 *
 * The message says what was received, what was expected, and what to do.
 */
export class StreamError extends Error {
  override readonly name = "StreamError";
  /**
   * An error code of the protocol; or `unreachable` (no answer), `origin_not_allowed` (an answer that the browser keeps from
   * this page), `invalid_url`, `unsupported_version` (of the scene
   * format), `damaged` (what came cannot be read, or has another hash), `refused` (any other HTTP status),
   * `several_scenes` (a server URL where one scene is meant), and those of core/client.
   */
  readonly code: string;
  /** HTTP status or WebSocket close code, where there was one. */
  readonly status: number | undefined;

  constructor(code: string, message: string, status?: number, options?: { cause?: unknown }) {
    super(message, options);
    this.code = code;
    this.status = status;
  }

  /** JSON omits name and message of an Error by default. */
  toJSON(): object {
    const { name, code, message, status } = this;
    return { name, code, message, status };
  }
}
