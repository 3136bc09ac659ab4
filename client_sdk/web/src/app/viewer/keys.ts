/** The keyboard: held keys move, pressed keys act. Everything that a mouse can do, keys can. */

import type { WalkInput } from "../walk-pose.ts";

/** What a key asks for. */
export type KeyAction =
  | "aim"
  | "land"
  | "cancel"
  | "home"
  | "view"
  | "tool-land"
  | "tool-pick"
  | "tool-measure"
  | "tool-brush"
  | "undo"
  | "panel"
  | "keep"
  | "compare"
  | "help";

const ACTIONS: Readonly<Record<string, KeyAction>> = {
  Space: "aim",
  KeyE: "aim",
  Enter: "land",
  NumpadEnter: "land",
  Escape: "cancel",
  Home: "home",
  KeyH: "home",
  KeyV: "view",
  KeyL: "tool-land",
  KeyP: "tool-pick",
  KeyM: "tool-measure",
  KeyT: "tool-brush",
  Backspace: "undo",
  KeyI: "panel",
  KeyB: "keep",
  KeyC: "compare",
};

const HELD = new Set([
  "KeyW",
  "KeyA",
  "KeyS",
  "KeyD",
  "ArrowUp",
  "ArrowDown",
  "ArrowLeft",
  "ArrowRight",
  "PageUp",
  "PageDown",
  "Equal",
  "NumpadAdd",
  "Minus",
  "NumpadSubtract",
  "ShiftLeft",
  "ShiftRight",
]);

/** The keyboard, as the viewer reads it. */
export interface Keys {
  /** What the held keys want now; arrows turn where `arrowsTurn`, and walk forward and back in either case. */
  input(arrowsTurn: boolean): WalkInput;
  /** 1 nearer, -1 farther. */
  zoom(): number;
  readonly isHolding: boolean;
  dispose(): void;
}

/** Whether a key that was pressed with the focus on `target` is meant for the scene. */
function isForScene(target: EventTarget | null, canvas: HTMLElement): boolean {
  return target === canvas || target === document.body;
}

/** Listen. `changed` is called when a held key goes down or up. */
export function listenToKeys(canvas: HTMLElement, act: (action: KeyAction) => void, changed: () => void): Keys {
  const pressedCodes = new Set<string>();
  const abort = new AbortController();
  const options = { signal: abort.signal };
  const on = (code: string, otherCode = "") => (pressedCodes.has(code) || pressedCodes.has(otherCode) ? 1 : 0);

  document.addEventListener(
    "keydown",
    (event) => {
      // Whoever types into a field, or means a shortcut of the browser, does not move the camera.
      if (!isForScene(event.target, canvas) || event.ctrlKey || event.metaKey || event.altKey) return;
      // By what is printed on the key: where "?" is differs from keyboard to keyboard.
      const action = event.key === "?" ? "help" : ACTIONS[event.code];
      if (HELD.has(event.code)) {
        if (!event.code.startsWith("Shift")) event.preventDefault();
        pressedCodes.add(event.code);
        changed();
      } else if (action !== undefined && !event.repeat) {
        event.preventDefault();
        act(action);
      }
    },
    options,
  );
  document.addEventListener(
    "keyup",
    (event) => {
      if (pressedCodes.delete(event.code)) changed();
    },
    options,
  );
  // A key that goes up in another window is never told.
  window.addEventListener("blur", () => pressedCodes.clear(), options);

  return {
    input(arrowsTurn) {
      const sideways = on("ArrowRight") - on("ArrowLeft");
      return {
        forward: on("KeyW") - on("KeyS") + (arrowsTurn ? on("ArrowUp") - on("ArrowDown") : 0),
        right: on("KeyD") - on("KeyA"),
        turn: sideways,
        nod: on("PageUp") - on("PageDown") + (arrowsTurn ? 0 : on("ArrowUp") - on("ArrowDown")),
        fast: on("ShiftLeft", "ShiftRight") === 1,
      };
    },
    zoom: () => on("Equal", "NumpadAdd") - on("Minus", "NumpadSubtract"),
    get isHolding() {
      return pressedCodes.size > 0;
    },
    dispose() {
      abort.abort();
    },
  };
}
