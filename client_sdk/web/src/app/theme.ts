/** Light and dark: as the system has it, until the user says otherwise. */

import type { KeyValueStorage } from "./bookmarks.ts";
import { h, setAttribute } from "./dom.ts";
import { icon } from "./icons.ts";

/** The choice that is kept; `system` follows the device's own setting. */
export type ThemeChoice = "system" | "light" | "dark";

/** What is shown. */
export type Theme = "light" | "dark";

const KEY = "terraport.theme";
const NEXT: Readonly<Record<ThemeChoice, ThemeChoice>> = { system: "light", light: "dark", dark: "system" };
const ICONS = { system: "auto", light: "sun", dark: "moon" } as const;

/** Theme in force, and the button that changes it. */
export interface ThemeSwitch {
  readonly theme: Theme;
  /** A button that goes from system to light to dark. Each call makes one more; all stay current. */
  button(): HTMLButtonElement;
  subscribe(listener: (theme: Theme) => void): () => void;
}

/** Follow the system and the user's choice. */
export function createThemeSwitch(storage: KeyValueStorage): ThemeSwitch {
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const listeners = new Set<(theme: Theme) => void>();
  let choice = stored(storage);

  const theme = (): Theme => (choice === "system" ? (system.matches ? "dark" : "light") : choice);
  const apply = () => {
    document.documentElement.dataset.theme = theme();
    for (const listener of listeners) listener(theme());
  };
  const choose = (next: ThemeChoice) => {
    choice = next;
    try {
      storage.setItem(KEY, next);
    } catch {
      // Not kept for the next time; it holds for this one.
    }
    apply();
  };
  system.addEventListener("change", apply);
  apply();

  return {
    get theme() {
      return theme();
    },
    button() {
      const button = h("button", {
        type: "button",
        class: "icon-button",
        "data-action": "theme",
        on: { click: () => choose(NEXT[choice]) },
      });
      const show = () => {
        button.replaceChildren(icon(ICONS[choice]));
        const name = choice === "system" ? `as the system (${theme()})` : choice;
        setAttribute(button, "aria-label", `Colours: ${name}. Change to ${NEXT[choice]}`);
        setAttribute(button, "title", `Colours: ${name}`);
      };
      listeners.add(show);
      show();
      return button;
    },
    subscribe(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
  };
}

function stored(storage: KeyValueStorage): ThemeChoice {
  try {
    const text = storage.getItem(KEY);
    return text === "light" || text === "dark" ? text : "system";
  } catch {
    return "system";
  }
}
