/** A newcomer's first minute: three hints, one after the other, none of them twice on a device. */

import type { Announcer } from "../announcer.ts";
import type { KeyValueStorage } from "../bookmarks.ts";
import { h, setShown, setText } from "../dom.ts";
import type { ViewerState, ViewerStore } from "./state.ts";

/** The hint, and what makes it go. */
export interface Hints {
  readonly element: HTMLElement;
  /** The user has looked round by himself. */
  looked(): void;
  dispose(): void;
}

/** Where the browser keeps how many of them were seen. */
export const HINTS_KEY = "terraport.hints";

interface Hint {
  readonly text: string;
  /** Whether the user has just done what it says. */
  isDone(state: ViewerState): boolean;
}

/** What is told, in order; done as the user does it, or by its button. */
export function hintsFor(isTouch: boolean): readonly Hint[] {
  const [look, click, compare] = isTouch
    ? ["Drag to look round, pinch to come nearer.", "Tap", "The button with the line"]
    : ["Drag to look round, turn the wheel to come nearer.", "Click", "The C key"];
  return [
    { text: look!, isDone: () => false },
    {
      text: `${click} the ground: all that was surveyed there is loaded, and you are taken to it.`,
      isDone: ({ landed }) => landed !== null,
    },
    {
      text: `${compare} shows before and after, the house leads back, the question mark tells the rest.`,
      isDone: ({ split }) => split !== null,
    },
  ];
}

/** How many were seen, from what the browser kept: none where that is no such number. */
export function seenHints(kept: string | null, count: number): number {
  const seen = Number(kept ?? 0);
  return Number.isInteger(seen) && seen >= 0 ? Math.min(seen, count) : 0;
}

/** Build the card; null where there is nothing left to tell. */
export function createHints(
  store: ViewerStore,
  storage: KeyValueStorage,
  announcer: Announcer,
  isTouch: boolean,
): Hints | null {
  const hints = hintsFor(isTouch);
  let hasLooked = false;
  let seen = seenHints(storage.getItem(HINTS_KEY), hints.length);
  if (seen === hints.length) return null;

  const count = h("span", { class: "faint number" });
  const text = h("p", { id: "hint" });
  const next = h("button", { type: "button", class: "button", "data-action": "next-hint", on: { click: () => go(1) } });
  const none = h(
    "button",
    { type: "button", class: "button quiet", "data-action": "no-hints", on: { click: () => go(hints.length) } },
    "No hints",
  );
  const element = h(
    "div",
    { class: "hint-card", role: "region", "aria-label": "Hint" },
    count,
    text,
    h("div", { class: "hint-actions" }, none, next),
  );

  function go(by: number): void {
    seen = Math.min(seen + by, hints.length);
    storage.setItem(HINTS_KEY, String(seen));
    show();
  }

  function show(): void {
    const hint = hints[seen];
    setShown(element, hint !== undefined);
    if (hint === undefined) return;
    setText(count, `${seen + 1} of ${hints.length}`);
    setText(text, hint.text);
    const isLast = seen === hints.length - 1;
    setText(next, isLast ? "Got it" : "Next");
    setShown(none, !isLast);
    announcer.announce(hint.text);
  }

  /** Actions may be done in any order: a user who has already landed is not asked to land after looking around. */
  function skipDone(state: ViewerState): void {
    while (seen === 0 ? hasLooked : hints[seen]?.isDone(state) === true) go(1);
  }

  const stop = store.subscribe(skipDone);
  show();
  return {
    element,
    looked() {
      hasLooked = true;
      skipDone(store.get());
    },
    dispose: stop,
  };
}
