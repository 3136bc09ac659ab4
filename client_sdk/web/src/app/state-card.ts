/** A page that is nothing but one message: loading, failed, not able to. */

import { type Child, h } from "./dom.ts";
import { type IconName, icon } from "./icons.ts";

/** Content of a card that stands in place of a page: loading, empty or failed. */
export interface StateCard {
  readonly id: string;
  readonly icon: IconName;
  readonly title: string;
  readonly failed?: boolean;
  readonly children?: readonly Child[];
  readonly actions?: readonly HTMLElement[];
}

/** Make it. A failure is an alert; everything else is said when there is time. */
export function stateCard(card: StateCard): HTMLElement {
  return h(
    "div",
    { class: "state-page" },
    h(
      "section",
      {
        id: card.id,
        class: card.failed ? "state-card failed" : "state-card",
        role: card.failed ? "alert" : "status",
      },
      icon(card.icon),
      h("h1", {}, card.title),
      ...(card.children ?? []),
      h("div", { class: "state-actions" }, ...(card.actions ?? [])),
    ),
  );
}

/** A button with words. */
export function actionButton(name: string, action: string, run: () => void, primary = false): HTMLButtonElement {
  return h(
    "button",
    { type: "button", class: primary ? "button primary" : "button", "data-action": action, on: { click: run } },
    name,
  );
}
