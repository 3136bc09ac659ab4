/** What keys mean, on keyboards of several layouts and scripts. */

import { describe, expect, it } from "vitest";
import { meaningOf } from "../src/app/viewer/keys.ts";

/** Position on a US keyboard, what is printed there, and what it means. */
const KEYS: readonly (readonly [layout: string, code: string, key: string, meaning: object])[] = [
  ["US", "KeyW", "w", { held: "forward" }],
  ["US with Caps Lock", "KeyV", "V", { action: "view" }],
  ["US", "Equal", "=", { held: "nearer" }],
  ["US", "Slash", "?", { action: "help" }],
  ["US", "KeyX", "x", {}],
  ["any", "Space", " ", { action: "aim" }],
  ["any", "NumpadEnter", "Enter", { action: "land" }],
  ["any", "NumpadAdd", "+", { held: "nearer" }],
  ["any, Num Lock off", "Numpad8", "ArrowUp", { held: "up" }],
  ["French", "KeyW", "z", { held: "forward" }],
  ["French", "KeyQ", "a", {}],
  ["French", "KeyA", "q", { held: "left" }],
  ["French", "Semicolon", "m", { action: "tool-measure" }],
  ["French", "KeyM", ",", {}],
  ["French", "Digit6", "-", { held: "farther" }],
  ["French", "KeyM", "?", { action: "help" }],
  ["German", "Slash", "-", { held: "farther" }],
  ["German", "BracketRight", "+", { held: "nearer" }],
  ["German", "Minus", "?", { action: "help" }],
  ["Dvorak", "KeyE", ".", {}],
  ["Dvorak", "KeyD", "e", { held: "right" }],
  ["Dvorak", "KeyP", "l", { action: "tool-land" }],
  ["Dvorak", "KeyR", "p", { action: "tool-pick" }],
  ["BÉPO", "KeyT", "è", {}],
  ["BÉPO", "KeyW", "é", { held: "forward" }],
  ["Turkish Q", "KeyI", "ı", {}],
  ["Russian", "KeyV", "м", { action: "view" }],
  ["Russian", "KeyW", "ц", { held: "forward" }],
  ["Greek", "KeyP", "π", { action: "tool-pick" }],
  ["Hebrew", "KeyC", "ב", { action: "compare" }],
  ["Arabic", "Slash", "؟", { action: "help" }],
  ["on a screen", "", "w", { held: "forward" }],
  ["on a screen", "", "l", { action: "tool-land" }],
  ["being composed", "KeyE", "Dead", {}],
];

describe("a key", () => {
  it.each(KEYS)("%s: %s, printed %s", (_layout, code, key, meaning) => {
    expect(meaningOf({ code, key })).toEqual(meaning);
  });
});
