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

/** Actions, by the character printed on the key. */
const ACTIONS: Readonly<Record<string, KeyAction>> = {
  " ": "aim",
  e: "aim",
  enter: "land",
  escape: "cancel",
  home: "home",
  h: "home",
  v: "view",
  l: "tool-land",
  p: "tool-pick",
  m: "tool-measure",
  t: "tool-brush",
  backspace: "undo",
  i: "panel",
  b: "keep",
  c: "compare",
  "?": "help",
  "؟": "help",
};

/** Directions of keys that move while they are held, by the character printed on the key. */
const HELD: Readonly<Record<string, string>> = {
  arrowup: "up",
  arrowdown: "down",
  arrowleft: "turn left",
  arrowright: "turn right",
  pageup: "nod up",
  pagedown: "nod down",
  "+": "nearer",
  "=": "nearer",
  "-": "farther",
  _: "farther",
  shift: "fast",
};

/** Directions of keys that walk, by their position under the left hand, whatever is printed on them. */
const WALKS: Readonly<Record<string, string>> = { w: "forward", a: "left", s: "back", d: "right" };

/** Letters printed on the keys that walk, if known from the browser or a pressed key; else those of a US keyboard. */
const printed = { w: "W", a: "A", s: "S", d: "D" };

/** The letters printed on the keys that walk: "W A S D", or "Z Q S D" on a French keyboard. */
export function walkLetters(): string {
  return Object.values(printed).join(" ");
}

/** The parts of a keyboard event that are read. */
export type KeyPress = Pick<KeyboardEvent, "key" | "code">;

/** The letter of a US keyboard at the key's position; "" for every other key. */
function positionOf({ code }: KeyPress): string {
  return code.startsWith("Key") ? code.slice(3).toLowerCase() : "";
}

/**
 * What a key does: a direction while it is held, or an action.
 *
 * Shortcut letters are those printed on the key. On a keyboard with another script, whose keys do not type Latin letters,
 * they are key positions, since Latin letters are also printed on these keyboards.
 */
export function meaningOf(event: KeyPress): { readonly held?: string; readonly action?: KeyAction } {
  const position = positionOf(event);
  const isOtherScript = /^\p{L}$/u.test(event.key) && !/\p{Script=Latin}/u.test(event.key);
  const key = isOtherScript && position !== "" ? position : event.key.toLowerCase();
  // On-screen keyboards and some remote desktops report no position.
  const held = WALKS[event.code === "" ? key : position] ?? HELD[key];
  if (held !== undefined) return { held };
  const action = ACTIONS[key];
  return action === undefined ? {} : { action };
}

/** The keyboard, as the viewer reads it. */
export interface Keys {
  /** What the held keys want now; arrows turn where `arrowsTurn`, and walk forward and back in either case. */
  input(arrowsTurn: boolean): WalkInput;
  /** 1 nearer, -1 farther. */
  zoom(): number;
  dispose(): void;
}

/** Controls that receive every key: typing in them is not a shortcut. A dialog is modal. */
const TAKES_ALL =
  "input:not([type=checkbox],[type=radio],[type=range],[type=color],[type=file],[type=button]),textarea,select,[contenteditable],dialog";

/** Listen. `changed` is called when a held key goes down or up. */
export function listenToKeys(canvas: HTMLElement, act: (action: KeyAction) => void, changed: () => void): Keys {
  /** Action of each key that is down, by its position. */
  const pressed = new Map<string, string>();
  /** The control that was clicked last; null after the user presses the Tab key. */
  let clicked: Element | null = null;
  const abort = new AbortController();
  const options = { signal: abort.signal };
  const on = (held: string) => Number([...pressed.values()].includes(held));
  const idOf = ({ code, key }: KeyPress) => code || key.toLowerCase();

  /**
   * Return whether the focused control receives this key. A control that was reached with the Tab key receives the keys that
   * it may use: Enter, Space, arrows. A control that was clicked does not: the user has returned to the scene.
   */
  function isTaken(target: EventTarget | null, key: string): boolean {
    if (!(target instanceof Element) || target === canvas || target === document.body) return false;
    if (target.closest(TAKES_ALL) !== null) return true;
    const isClicked = target === clicked || target === (clicked as HTMLLabelElement | null)?.control;
    return !isClicked && /^( |Enter|Home|End|Arrow.*|Page.*)$/.test(key);
  }

  document.addEventListener(
    "pointerdown",
    ({ target }) => {
      // Look up the control before the click: a click may replace the icon of a button.
      clicked = (target as Element).closest("button,a,summary,input,label,[tabindex]");
    },
    { ...options, capture: true },
  );
  document.addEventListener(
    "keydown",
    (event) => {
      if (event.key === "Tab") clicked = null;
      // Shortcuts of the browser. While Meta is down, some systems do not report that other keys go up.
      if (event.metaKey) pressed.clear();
      if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return;
      if (isTaken(event.target, event.key)) return;
      const { held, action } = meaningOf(event);
      if (held === undefined && action === undefined) return;
      // In the capture phase, else a tab that was clicked would handle the arrow keys.
      if (held !== "fast") {
        event.preventDefault();
        event.stopPropagation();
      }
      if (held !== undefined) {
        const position = positionOf(event);
        if (position in printed && event.key.length === 1) {
          printed[position as keyof typeof printed] = event.key.toUpperCase();
        }
        pressed.set(idOf(event), held);
        changed();
      } else if (action !== undefined && !event.repeat) {
        act(action);
      }
    },
    { ...options, capture: true },
  );
  document.addEventListener(
    "keyup",
    (event) => {
      if (pressed.delete(idOf(event))) changed();
      // Firefox clicks a focused button when Space goes up.
      if (event.key === " " && !isTaken(event.target, event.key)) event.preventDefault();
    },
    options,
  );
  // A key that goes up in another window is never told.
  window.addEventListener("blur", () => pressed.clear(), options);

  // Only Chromium reports the keyboard layout before a key is pressed.
  const { keyboard } = navigator as { keyboard?: { getLayoutMap?(): Promise<ReadonlyMap<string, string>> } };
  keyboard?.getLayoutMap?.().then(
    (layout) => {
      for (const key of Object.keys(printed) as (keyof typeof printed)[]) {
        printed[key] = layout.get(`Key${key.toUpperCase()}`)?.toUpperCase() ?? printed[key];
      }
    },
    () => undefined, // In a frame of another origin it may be forbidden.
  );

  return {
    input(arrowsTurn) {
      const ahead = on("up") - on("down");
      return {
        forward: on("forward") - on("back") + (arrowsTurn ? ahead : 0),
        right: on("right") - on("left"),
        turn: on("turn right") - on("turn left"),
        nod: on("nod up") - on("nod down") + (arrowsTurn ? 0 : ahead),
        fast: on("fast") === 1,
      };
    },
    zoom: () => on("nearer") - on("farther"),
    dispose() {
      abort.abort();
    },
  };
}
