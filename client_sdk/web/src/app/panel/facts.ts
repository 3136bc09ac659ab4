/** A list of names and values. */

import { type Child, h, setText } from "../dom.ts";

/** The list; values can be set one by one. */
export interface Facts {
  readonly element: HTMLElement;
  /** An empty text hides the row. */
  set(key: string, text: string): void;
}

/** Make a list with a row for each key. `data-fact` names the values. */
export function createFacts(rows: readonly (readonly [key: string, title: string])[]): Facts {
  const values = new Map<string, { readonly row: HTMLElement; readonly value: HTMLElement }>();
  const children: Child[] = [];
  for (const [key, title] of rows) {
    const value = h("dd", { class: "number", "data-fact": key });
    const row = h("div", { class: "fact" }, h("dt", {}, title), value);
    row.hidden = true;
    values.set(key, { row, value });
    children.push(row);
  }
  return {
    element: h("dl", { class: "facts" }, ...children),
    set(key, text) {
      const entry = values.get(key);
      if (entry === undefined) return;
      setText(entry.value, text);
      entry.row.hidden = text === "";
    },
  };
}
