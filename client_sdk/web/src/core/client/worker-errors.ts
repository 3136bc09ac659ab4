/** Errors on their way from a worker: a class does not survive the passage, its fields do. */

import { PayloadError } from "../payload/errors.ts";
import { StreamError } from "../scene/errors.ts";

/** A {@link StreamError} as a plain value. */
export interface SentError {
  readonly code: string;
  readonly message: string;
  readonly status: number | undefined;
}

/** Any failure as a value to send. */
export function sentError(error: unknown): SentError {
  const { code, message, status } = asStreamError(error);
  return { code, message, status };
}

/** The error that such a value stands for. */
export function receivedError(error: SentError): StreamError {
  return new StreamError(error.code, error.message, error.status);
}

/** Any failure as a {@link StreamError}. */
export function asStreamError(error: unknown): StreamError {
  if (error instanceof StreamError) return error;
  const message = error instanceof Error ? error.message : String(error);
  if (error instanceof PayloadError) return new StreamError("damaged", message, undefined, { cause: error });
  return new StreamError("internal", message, undefined, { cause: error });
}

/** What an `error` or `messageerror` event of a worker tells. */
export function workerFailure(workerName: string, event: Event): StreamError {
  const reason = "message" in event && typeof event.message === "string" ? event.message : "";
  return new StreamError(
    "worker_failed",
    `${workerName} failed: ${reason || "its script did not load, or it was ended"}`,
  );
}
