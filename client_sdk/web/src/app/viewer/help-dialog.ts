/** How to move, aim, land and look: for mouse, touch and keys. */

import { h } from "../dom.ts";
import { icon } from "../icons.ts";
import { walkLetters } from "./keys.ts";

/** Modal list of keys and gestures. */
export interface HelpDialog {
  readonly element: HTMLDialogElement;
  open(): void;
}

const SECTIONS: readonly (readonly [title: string, rows: readonly (readonly [what: string, how: string])[]])[] = [
  [
    "Land",
    [
      ["Land there", "Click or tap the ground. You are taken there when its detail is here."],
      ["Aim first", "Hold still, and let go. Detail begins to load while you hold; a drag cancels it."],
      ["Cancel", "Escape"],
      ["With keys alone", "Enter lands at the middle of the picture; Space or E aims there first."],
      ["Before and after", "C"],
    ],
  ],
  [
    "Orbit",
    [
      ["Turn", "Drag; ← → and Page up, Page down or ↑ ↓"],
      ["Move", "Right button or Shift and drag, two fingers; WASD"],
      ["Nearer, farther", "Wheel, pinch; + and −"],
      ["Whole scene", "H or Home"],
    ],
  ],
  [
    "Walk",
    [
      ["Look round", "Drag; ← →, Page up, Page down"],
      ["Walk", "WASD, ↑ ↓, or the pad on a touch screen"],
      ["Run", "Shift"],
      ["Orbit or walk", "V"],
    ],
  ],
  [
    "Look at data",
    [
      ["Land, pick, measure", "L, P, M"],
      ["Take back a measured point", "Backspace"],
      [
        "Teach names with a brush",
        "T, where the service lets you; drag on the ground. Backspace takes the last stroke back",
      ],
      ["Keep this place", "B"],
      ["Panel", "I"],
    ],
  ],
];

/** Make it, closed. */
export function createHelpDialog(): HelpDialog {
  const close = h(
    "button",
    { type: "button", class: "icon-button", "aria-label": "Close", on: { click: () => element.close() } },
    icon("close"),
  );
  const element = h(
    "dialog",
    { id: "help-dialog", class: "dialog help", "aria-labelledby": "help-title" },
    h("div", { class: "dialog-head" }, h("h2", { id: "help-title" }, "How to look around"), close),
    h(
      "div",
      { class: "help-sections" },
      ...SECTIONS.map(([title, rows]) =>
        h(
          "section",
          {},
          h("h3", {}, title),
          h("dl", {}, ...rows.flatMap(([action, keys]) => [h("dt", {}, action), h("dd", {}, keys)])),
        ),
      ),
    ),
  );
  const walks = [...element.querySelectorAll("dd")].filter((dd) => dd.textContent.includes("WASD"));
  const texts = walks.map((dd) => dd.textContent);
  return {
    element,
    open() {
      for (const [row, dd] of walks.entries()) dd.textContent = texts[row]!.replace("WASD", walkLetters());
      element.showModal();
    },
  };
}
