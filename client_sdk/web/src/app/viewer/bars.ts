/** The bar at the top (where am I, is it connected) and the bar of tools. */

import { h, setAttribute, setShown, setText } from "../dom.ts";
import { type IconName, icon } from "../icons.ts";
import type { KeyAction } from "./keys.ts";
import type { Tool, ViewerState, ViewerStore } from "./state.ts";

/** State to show, and what the buttons do. */
export interface BarOptions {
  readonly store: ViewerStore;
  readonly name: string;
  readonly themeButton: HTMLButtonElement;
  act(action: KeyAction): void;
  enterHeadset(): void;
}

/** Two elements for the viewer's layout; `showHeadset` brings the button that enters VR. */
export interface Bars {
  readonly top: HTMLElement;
  readonly tools: HTMLElement;
  showHeadset(supported: boolean): void;
}

const LINK_TEXTS = {
  open: "Connected",
  connecting: "Connecting…",
  waiting: "Connection lost",
  closed: "Disconnected",
} as const;

/** Build both bars; they follow the store. */
export function createBars({ store, name, themeButton, act, enterHeadset }: BarOptions): Bars {
  const iconButton = (image: IconName, title: string, action: string, run: () => void) =>
    h(
      "button",
      { type: "button", class: "icon-button", "data-action": action, "aria-label": title, title, on: { click: run } },
      icon(image),
    );

  // --- Top: where am I, and is it connected
  const dot = h("span", { class: "link-dot", "aria-hidden": "true" });
  const linkText = h("span", { class: "faint", id: "link-state" });
  const headset = h(
    "button",
    { type: "button", class: "button primary", id: "enter-headset", hidden: true, on: { click: enterHeadset } },
    icon("headset"),
    h("span", { class: "bar-words" }, "Enter VR"),
  );
  headset.setAttribute("aria-label", "Enter VR");
  const panelButton = iconButton("panel", "Panel", "panel", () => act("panel"));
  panelButton.setAttribute("aria-controls", "panel");

  const top = h(
    "header",
    { class: "top-bar" },
    h("a", { class: "icon-button", href: "#list", "aria-label": "All scenes", title: "All scenes" }, icon("back")),
    h("div", { class: "top-name" }, h("h1", {}, name), h("p", { class: "link-line" }, dot, linkText)),
    headset,
    themeButton,
    iconButton("help", "Help: mouse, touch and keys", "help", () => act("help")),
    panelButton,
  );

  // --- Tools: which view, and what a click on the ground does
  const view = (kind: "orbit" | "walk", title: string) => {
    const button = h(
      "button",
      {
        type: "button",
        class: "icon-button with-words",
        "data-view": kind,
        title: `${title} (V)`,
        on: { click: () => store.get().view !== kind && act("view") },
      },
      icon(kind),
      h("span", {}, title),
    );
    return button;
  };
  const tool = (kind: Tool, title: string, key: string) =>
    h(
      "button",
      {
        type: "button",
        class: "icon-button with-words",
        "data-tool": kind,
        title: `${title} (${key})`,
        on: { click: () => act(`tool-${kind}`) },
      },
      icon(kind),
      h("span", {}, title),
    );
  const orbit = view("orbit", "Orbit");
  const walk = view("walk", "Walk");
  const tools: Readonly<Record<Tool, HTMLButtonElement>> = {
    land: tool("land", "Land", "L"),
    pick: tool("pick", "Pick", "P"),
    measure: tool("measure", "Measure", "M"),
    brush: tool("brush", "Teach", "T"),
  };
  const compare = iconButton("compare", "Before and after (C)", "compare", () => act("compare"));
  const bar = h(
    "div",
    { class: "tool-bar", role: "toolbar", "aria-label": "View and tools" },
    h("div", { class: "tool-group", role: "group", "aria-label": "View" }, orbit, walk),
    h(
      "div",
      { class: "tool-group", role: "group", "aria-label": "A click on the ground" },
      tools.land,
      tools.pick,
      tools.measure,
      store.get().manifest.mayPaint && tools.brush,
    ),
    h(
      "div",
      { class: "tool-group" },
      compare,
      iconButton("home", "Whole scene (H)", "home", () => act("home")),
    ),
  );

  function show(state: ViewerState): void {
    const link = state.link?.state ?? "connecting";
    setAttribute(dot, "data-state", link);
    setText(linkText, LINK_TEXTS[link]);
    setAttribute(panelButton, "aria-expanded", String(state.panelOpen));
    setAttribute(orbit, "aria-pressed", String(state.view === "orbit"));
    setAttribute(walk, "aria-pressed", String(state.view === "walk"));
    setAttribute(compare, "aria-pressed", String(state.split !== null));
    compare.disabled = state.gain === null;
    for (const [kind, button] of Object.entries(tools)) {
      setAttribute(button, "aria-pressed", String(state.tool === kind));
    }
  }

  store.subscribe(show);
  show(store.get());
  return {
    top,
    tools: bar,
    showHeadset: (supported) => setShown(headset, supported),
  };
}
