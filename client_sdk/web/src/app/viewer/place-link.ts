/** The address bar as the record of where the user is: one entry of the history for each landing. */

import { formatRoute, type Place, type Route } from "../route.ts";

/** Keeps the browser's address at what is shown. */
export interface PlaceLink {
  /** A landing was shown: a new entry, unless the address asked for it. */
  push(route: Route): void;
  /** The look has changed: the present entry follows, a little later. Null: the user is on his way elsewhere. */
  follow(route: () => Route | null): void;
  dispose(): void;
}

/** Browsers refuse more than some hundred changes in half a minute. */
const FOLLOW_MS = 500;

/** Keep it. */
export function createPlaceLink(): PlaceLink {
  let timer: number | null = null;
  let entry: { readonly timer: number; readonly route: Route } | null = null;
  const stopFollowing = () => {
    if (timer !== null) window.clearTimeout(timer);
    timer = null;
  };
  const writeEntry = () => {
    if (entry === null) return;
    window.clearTimeout(entry.timer);
    const hash = formatRoute(entry.route);
    entry = null;
    if (hash !== window.location.hash) window.history.pushState(null, "", hash);
  };
  const stop = () => {
    stopFollowing();
    if (entry !== null) window.clearTimeout(entry.timer);
    entry = null;
  };
  // Back or forward: what was to be written belongs to the entry that was left.
  window.addEventListener("popstate", stop);
  return {
    push(route) {
      stopFollowing();
      writeEntry(); // of a landing just before: two are two entries
      // Not in the frame of the swap: browsers take ten milliseconds for it.
      entry = { timer: window.setTimeout(writeEntry), route };
    },
    follow(route) {
      stopFollowing();
      timer = window.setTimeout(() => {
        timer = null;
        const newRoute = route();
        if (newRoute !== null) window.history.replaceState(null, "", formatRoute(newRoute));
      }, FOLLOW_MS);
    },
    dispose() {
      stop();
      window.removeEventListener("popstate", stop);
    },
  };
}

/** Without what the place alone decides: a focus at the landing itself is not written. */
export function shortPlace(place: Place): Place {
  const { focus, at } = place;
  const isAtFocus = focus !== null && Math.hypot(focus[0] - at[0], focus[1] - at[1], focus[2] - at[2]) < 0.01;
  return isAtFocus ? { ...place, focus: null } : place;
}
