/**
 * What is held, told to a server in messages that it takes.
 *
 * PURE. `spec/wire-protocol.md`, section 5, rule 3.
 */

import type { HeldRow } from "../wire/kinds.ts";
import type { HeldMessage, WelcomeMessage } from "../wire/messages.generated.ts";
import { LIMITS } from "../wire/messages.generated.ts";

/** Bytes of one row of a held table. */
const ROW_BYTES = 12;

/** Room for what stands around the table in its message. */
const AROUND_BYTES = 64;

/** One offer: as much as `hello` takes, and the rest after the welcome. */
export class HeldOffer {
  #remaining: readonly HeldRow[] = [];

  /**
   * What goes into `hello`.
   *
   * @param rows - everything that is held, most wanted first.
   * @param inHello - false: nothing, because the server found it too large; all of it goes after the welcome, which
   *   says how large a message may be.
   */
  first(rows: readonly HeldRow[], inHello: boolean): readonly HeldRow[] {
    const count = inHello ? LIMITS.MAX_HELD_SEGMENTS : 0;
    this.#remaining = rows.slice(count);
    return rows.slice(0, count);
  }

  /** The messages, once, that go after the welcome, and the rows that such a server cannot be told of. */
  remaining(welcome: WelcomeMessage): { messages: HeldMessage[]; unsendable: readonly HeldRow[] } {
    const rows = this.#remaining;
    this.#remaining = [];
    const { limits } = welcome;
    const fits = Math.floor((limits.max_message_bytes - AROUND_BYTES) / ROW_BYTES);
    const maxRows = Math.min(fits, limits.max_held_segments);
    if (maxRows < 1) return { messages: [], unsendable: rows };
    const messages: HeldMessage[] = [];
    for (let at = 0; at < rows.length; at += maxRows) {
      messages.push({ type: "held", segments: rows.slice(at, at + maxRows) });
    }
    return { messages, unsendable: [] };
  }
}
