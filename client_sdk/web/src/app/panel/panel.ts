/** The panel beside the picture (below it on a phone): landing, look, inspect, places, figures. */

import { h, setShown } from "../dom.ts";
import { icon } from "../icons.ts";
import type { PanelTab, ViewerStore } from "../viewer/state.ts";
import { createTabs } from "./tabs.ts";

/** What each tab shows. */
export type PanelContents = Readonly<Record<PanelTab, HTMLElement>>;

const TITLES: readonly (readonly [PanelTab, string])[] = [
  ["landing", "Landing"],
  ["look", "Look"],
  ["inspect", "Inspect"],
  ["places", "Places"],
  ["figures", "Figures"],
];

/** Make it; it opens and closes with the store. */
export function createPanel(store: ViewerStore, contents: PanelContents): HTMLElement {
  const tabs = createTabs(
    "Panel",
    TITLES.map(([name, title]) => ({ name, title, content: contents[name] })),
    (tab) => store.set({ tab }),
  );
  const close = h(
    "button",
    {
      type: "button",
      class: "icon-button panel-close",
      "data-action": "close-panel",
      "aria-label": "Close the panel",
      on: { click: () => store.set({ panelOpen: false }) },
    },
    icon("close"),
  );
  const panel = h(
    "aside",
    { id: "panel", class: "panel", "aria-label": "Panel" },
    h("div", { class: "panel-head" }, tabs.list, close),
    ...tabs.panels,
  );
  const show = () => {
    const { tab, panelOpen } = store.get();
    tabs.choose(tab);
    setShown(panel, panelOpen);
  };
  store.subscribe(show);
  show();
  return panel;
}
