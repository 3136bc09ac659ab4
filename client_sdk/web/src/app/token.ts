/**
 * The token that opens a service's scenes.
 *
 * Kept for this tab alone, and never in an address: addresses end up in histories, logs and mails.
 */

import type { KeyValueStorage } from "./bookmarks.ts";
import { h, setText } from "./dom.ts";
import { icon } from "./icons.ts";

const KEY = "terraport.token";
/** As the protocol has it. */
const MAX_LENGTH = 4096;

/** Why a token is asked for. */
export type TokenReason = "missing" | "refused" | "expired";

const TEXTS: Readonly<Record<TokenReason, string>> = {
  missing: "This service opens its scenes to whoever has a token. Ask its operator for one, and paste it here.",
  refused: "The service does not know that token. Check that all of it was copied, or ask its operator for another.",
  expired: "The token has expired or was withdrawn. What you see stays; paste a newer one to go on.",
};

/** The token, and the dialog that asks for it. */
export interface TokenKeeper {
  /** Undefined where none was given. */
  readonly token: string | undefined;
  /** Ask the user; null where the dialog is dismissed. Asking while it is open changes its text. */
  ask(reason: TokenReason): Promise<string | null>;
}

/** Make the keeper; its dialog is added to `parent`. */
export function createTokenKeeper(storage: KeyValueStorage, parent: Element): TokenKeeper {
  let token = storage.getItem(KEY) || undefined;
  let waiting: ((token: string | null) => void)[] = [];

  const reasonText = h("p", { id: "token-reason" });
  const input = h("input", {
    id: "token-input",
    name: "token",
    type: "password",
    autocomplete: "off",
    spellcheck: "false",
    maxlength: MAX_LENGTH,
    required: true,
    "aria-describedby": "token-reason",
  });
  const dialog = h(
    "dialog",
    { id: "token-dialog", class: "dialog", "aria-labelledby": "token-title" },
    h(
      "form",
      {
        on: {
          submit: (event) => {
            event.preventDefault();
            const text = input.value.trim();
            if (text) answer(text);
          },
        },
      },
      h("h2", { id: "token-title" }, icon("key"), "A token is needed"),
      reasonText,
      h("label", { for: "token-input" }, "Token"),
      input,
      h("p", { class: "faint" }, "Kept until this tab is closed. It is never part of a link."),
      h(
        "div",
        { class: "dialog-actions" },
        h("button", { type: "button", class: "button", on: { click: () => answer(null) } }, "Not now"),
        h("button", { type: "submit", class: "button primary" }, "Open"),
      ),
    ),
  );
  // Escape.
  dialog.addEventListener("cancel", (event) => {
    event.preventDefault();
    answer(null);
  });
  parent.append(dialog);

  function answer(newToken: string | null): void {
    if (newToken !== null) {
      token = newToken;
      try {
        storage.setItem(KEY, newToken);
      } catch {
        // Then it holds until the page is loaded again.
      }
    }
    input.value = "";
    dialog.close();
    // Everybody who asked meanwhile gets the same answer; who asks from within one waits for the next dialog.
    const resolved = waiting;
    waiting = [];
    for (const resolve of resolved) resolve(newToken);
  }

  return {
    get token() {
      return token;
    },
    ask(reason) {
      setText(reasonText, TEXTS[reason]);
      if (!dialog.open) dialog.showModal();
      input.focus();
      return new Promise((resolve) => waiting.push(resolve));
    },
  };
}
