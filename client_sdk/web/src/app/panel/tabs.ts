/** Tabs by the ARIA pattern: arrows move between them, and the focus enters at the chosen one. */

import { h } from "../dom.ts";

/** One tab and what it shows. */
export interface Tab<Name extends string> {
  readonly name: Name;
  readonly title: string;
  readonly content: HTMLElement;
}

/** The row of tabs, and one panel for each; the caller places both. */
export interface Tabs<Name extends string> {
  readonly list: HTMLElement;
  readonly panels: readonly HTMLElement[];
  choose(name: Name): void;
}

/** Make them; `chosen` is called when the user chooses one. */
export function createTabs<Name extends string>(
  label: string,
  tabs: readonly Tab<Name>[],
  chosen: (name: Name) => void,
): Tabs<Name> {
  const buttons = new Map<Name, HTMLButtonElement>();
  const panels = new Map<Name, HTMLElement>();
  const names = tabs.map(({ name }) => name);

  for (const { name, title, content } of tabs) {
    const button = h(
      "button",
      {
        type: "button",
        role: "tab",
        class: "tab",
        id: `tab-${name}`,
        "aria-controls": `panel-${name}`,
        on: {
          click: () => chosen(name),
          keydown: (event) => {
            // Round at both ends, as the pattern has it.
            const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
            const next =
              step !== undefined
                ? names[(names.indexOf(name) + step + names.length) % names.length]
                : { Home: names[0], End: names[names.length - 1] }[event.key];
            if (next === undefined) return;
            event.preventDefault();
            chosen(next);
            buttons.get(next)?.focus();
          },
        },
      },
      title,
    );
    buttons.set(name, button);
    const panel = h(
      "div",
      { role: "tabpanel", class: "tab-panel", id: `panel-${name}`, "aria-labelledby": `tab-${name}`, tabindex: 0 },
      content,
    );
    panels.set(name, panel);
  }
  return {
    list: h("div", { role: "tablist", class: "tabs", "aria-label": label }, ...buttons.values()),
    panels: [...panels.values()],
    choose(name) {
      for (const [buttonName, button] of buttons) {
        button.setAttribute("aria-selected", String(buttonName === name));
        // One stop of the Tab key for all tabs; the arrows go on from it.
        button.tabIndex = buttonName === name ? 0 : -1;
      }
      for (const [panelName, panel] of panels) panel.hidden = panelName !== name;
    },
  };
}
