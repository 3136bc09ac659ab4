/** Before and after: a line over the picture, the base alone to the left of it, what the landing brought to the right. */

import type { Gain } from "../../three/gain.ts";
import { pointSpacingM } from "../../three/gain.ts";
import { h, setShown, setText } from "../dom.ts";
import { formatSpacing } from "../format.ts";
import type { ViewerState, ViewerStore } from "./state.ts";

/** The line, and the card that tells what became sharp. */
export interface CompareView {
  readonly line: HTMLElement;
  readonly card: HTMLElement;
  dispose(): void;
}

/** Where the line stands when it appears. */
export const SPLIT_AT_START = 0.5;
/** So long the card stays by itself. */
const CARD_MS = 12_000;
/** Steps of the line by keys. */
const STEPS = 200;

/** How many times as fine full detail is, and from what to what. */
export function gainText({ detailFaces, baseFaces, areaM2 }: Gain): string {
  const before = formatSpacing(pointSpacingM(areaM2, baseFaces));
  const after = formatSpacing(pointSpacingM(areaM2, detailFaces));
  const times = detailFaces / baseFaces;
  return `A point every ${after}, ${before} before: ${times.toFixed(times < 9.95 ? 1 : 0)} times the triangles.`;
}

/** Build both; they follow the store. */
export function createCompareView(store: ViewerStore, toggle: () => void): CompareView {
  const input = h("input", {
    type: "range",
    id: "compare-split",
    min: 0,
    max: STEPS,
    "aria-label": "Before and after: where full detail begins",
    on: { input: () => store.set({ split: Number(input.value) / STEPS }) },
  });
  const line = h(
    "div",
    { class: "compare", hidden: true },
    h("span", { class: "compare-label before" }, "Base"),
    h("span", { class: "compare-label after" }, "Full detail"),
    h("div", { class: "compare-line", "aria-hidden": "true" }),
    input,
  );
  const text = h("p", { id: "gain" });
  const button = h("button", { type: "button", class: "button", "data-action": "compare", on: { click: toggle } });
  const card = h("div", { class: "gain-card", hidden: true }, text, button);
  let timer: number | null = null;

  const hideCard = () => setShown(card, false);

  function show(state: ViewerState, before: ViewerState | null): void {
    const { split, gain } = state;
    setShown(line, split !== null);
    if (split !== null) {
      line.style.setProperty("--split", `${split * 100}%`);
      input.value = String(Math.round(split * STEPS));
    }
    setText(button, split === null ? "Before / after" : "Done");
    if (gain === before?.gain && split === before?.split) return;
    if (timer !== null) window.clearTimeout(timer);
    setShown(card, gain !== null);
    if (gain === null) return;
    setText(text, `Now sharp. ${gainText(gain)}`);
    // While it is compared the numbers belong to the picture.
    timer = split === null ? window.setTimeout(hideCard, CARD_MS) : null;
  }

  const stop = store.subscribe(show);
  show(store.get(), null);
  return {
    line,
    card,
    dispose() {
      stop();
      if (timer !== null) window.clearTimeout(timer);
    },
  };
}
