/** What is said to whoever does not see the picture: landings and what fails. */

import { h } from "./dom.ts";

/** Live regions of the page. */
export interface Announcer {
  /** Say it when there is time; `urgent` says it at once. */
  announce(text: string, urgent?: boolean): void;
}

/** Add the two live regions to `parent`. They must stand in the page before they are written. */
export function createAnnouncer(parent: Element): Announcer {
  const polite = h("div", { id: "live", class: "visually-hidden", role: "status", "aria-live": "polite" });
  const urgentRegion = h("div", { id: "live-urgent", class: "visually-hidden", role: "alert" });
  parent.append(polite, urgentRegion);
  return {
    announce(text, urgent = false) {
      const region = urgent ? urgentRegion : polite;
      // The same text again is news again: only a change is read out.
      region.textContent = region.textContent === text ? `${text}\u00a0` : text;
    },
  };
}
