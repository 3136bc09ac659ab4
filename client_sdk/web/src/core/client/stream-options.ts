/** Options of a stream: defaults and validation. PURE. */

import { budgetsFor } from "../budgets.ts";
import { helloMessage, type SessionOptions } from "../session/session.ts";
import type { StreamOptions } from "../types.ts";
import { encodeMessage } from "../wire/messages.ts";
import { CLIENT } from "./version.ts";

/**
 * Return the complete options of a session; the defaults are for a desktop computer.
 *
 * @throws RangeError on numbers that the protocol does not allow.
 */
export function sessionOptionsOf(options: StreamOptions): SessionOptions & { readonly cacheBytes: number } {
  const { maxTriangles, maxSegments, cacheBytes, creditBytes } = budgetsFor("desktop");
  const complete = {
    client: options.client ?? CLIENT,
    budgets: options.budgets ?? { maxTriangles, maxSegments },
    creditBytes: options.creditBytes ?? creditBytes,
    cacheBytes: options.cacheBytes ?? cacheBytes,
  };
  if (!(complete.creditBytes >= 1)) {
    throw new RangeError(`got creditBytes ${complete.creditBytes}, expected a number of bytes, 1 or more`);
  }
  if (!(complete.cacheBytes >= 0)) {
    throw new RangeError(`got cacheBytes ${complete.cacheBytes}, expected a number of bytes, 0 or more`);
  }
  encodeMessage(helloMessage(complete));
  return complete;
}
