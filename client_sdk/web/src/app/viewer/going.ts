/** Going to places: landings that the user or the address asks for, and the address that follows. */

import type { LandOptions, Vec3 } from "../../core/types.ts";
import { prefersLessMotion } from "../device.ts";
import { outsideNotice } from "../failures.ts";
import { outsideBy } from "../reach.ts";
import { isSameLanding, type Route } from "../route.ts";
import type { LandingOrder } from "./landing-desk.ts";
import type { Parts } from "./parts.ts";
import { landedText } from "./react.ts";
import { modeOf, placeOf, routeModeOf } from "./route-state.ts";
import type { Landed } from "./state.ts";

/** The ways to go. */
export interface Going {
  /** Returns the landing's number. */
  land(order: LandingOrder, options?: LandOptions): number;
  /** The newest order once more, with another radius. */
  landAgain(radiusM: number): void;
  /** Land where the user aims. */
  landAim(): void;
  /** Go where an address says; `isEntry` makes it an entry of the history. */
  follow(route: Route, isEntry: boolean): void;
  /** The first swap of a landing was made: put the user there. */
  arrived(order: LandingOrder): void;
  shown(landed: Landed, order: LandingOrder, isCompletion: boolean): void;
  /** The camera moved: by the user, or to a place. */
  moved(): void;
  setView(view: "orbit" | "walk"): void;
  routeNow(): Route;
  /** As `routeNow`; null while the user is on his way elsewhere. */
  settledRoute(): Route | null;
}

/** Make them. `parts` is asked when something happens, not before. */
export function createGoing(parts: () => Parts): Going {
  /** Since the newest landing the user has walked: to walk again is to go back to where he stood. */
  let hasWalked = false;
  let newest: LandingOrder | null = null;

  function land(order: LandingOrder, options?: LandOptions): number {
    const { notices, desk, loop } = parts();
    newest = order;
    notices.clear("landing");
    notices.clear("degraded");
    notices.clear("steep");
    sayIfOutside(order.place, order.radiusM);
    const landing = desk.land(order, options);
    loop.request();
    return landing;
  }

  /** Say that nothing can be at a place; whether that is so. */
  function sayIfOutside(place: Vec3, radiusM: number): boolean {
    const { notices, store } = parts();
    const outsideM = outsideBy(place, radiusM, store.get().manifest.bounds);
    if (outsideM !== null) notices.show(outsideNotice(outsideM, radiusM));
    return outsideM !== null;
  }

  function routeNow(): Route {
    const { store, camera } = parts();
    const { manifest, landed, mode } = store.get();
    return {
      scene: manifest.id,
      place: landed === null ? null : placeOf(landed, camera.look),
      mode: routeModeOf(mode, manifest),
    };
  }

  /** Null while the user is on his way: back or forward have put that place into the address, and there it stays. */
  function settledRoute(): Route | null {
    const { stage, store } = parts();
    const { phase, position, radiusM } = stage.status;
    const { landed } = store.get();
    const isThere =
      landed !== null && landed.radiusM === radiusM && position.every((value, axis) => value === landed.place[axis]);
    return isThere || phase === "refused" ? routeNow() : null;
  }

  function isBeyondDetail(): boolean {
    const { store, camera } = parts();
    const { landed } = store.get();
    const [x, , z] = camera.focus;
    return landed !== null && Math.hypot(x - landed.place[0], z - landed.place[2]) > landed.effectiveRadiusM;
  }

  function moved(): void {
    const { store, camera, link, loop } = parts();
    hasWalked ||= camera.view === "walk";
    store.set({ view: camera.view, outside: camera.view === "walk" && isBeyondDetail() });
    if (store.get().landed !== null) link.follow(settledRoute);
    loop.request();
  }

  return {
    land,
    routeNow,
    settledRoute,
    moved,
    landAgain(radiusM) {
      if (newest !== null) land({ ...newest, radiusM });
    },
    landAim() {
      const { aim } = parts().store.get();
      if (aim !== null) land({ place: aim.place, radiusM: aim.radiusM, look: null, isEntry: true });
    },
    follow(route, isEntry) {
      const { store, camera } = parts();
      const { manifest, landed } = store.get();
      store.set({ mode: modeOf(route.mode, manifest) });
      const { place } = route;
      if (place === null) return;
      const radiusM = place.radiusM ?? store.get().radiusM;
      store.set({ radiusM });
      // Nobody is led out of the scene by a link: what is shown stays.
      if (sayIfOutside(place.at, radiusM)) return;
      if (landed !== null && isSameLanding(place, placeOf(landed, camera.look))) {
        camera.moveTo(place.at, place, !prefersLessMotion());
        moved();
        return;
      }
      land({ place: place.at, radiusM, look: place, isEntry });
    },
    arrived({ place, look }) {
      const { store, camera, stand } = parts();
      const { bringsCamera } = store.get();
      // On what is shown now: an aim was at what was shown before. Feet that a link tells stood there already.
      const walks = (look?.view ?? camera.view) === "walk" && (look?.focus ?? null) === null;
      const at = walks ? stand(place) : place;
      if (look !== null) camera.moveTo(at, look, false);
      else if (camera.view === "walk") camera.moveTo(at, null, false);
      else if (bringsCamera) camera.moveTo(place, null, true);
      hasWalked = camera.view === "walk";
      store.set({ view: camera.view, outside: false });
    },
    shown(landed, order, isCompletion) {
      const { markers, notices, shell, link } = parts();
      markers.setEdge(landed.place, landed.effectiveRadiusM);
      if (landed.degraded) {
        notices.show({
          key: "degraded",
          tone: "warning",
          title: "Only the middle is shown so far",
          text: "The connection is slow. The rest of this landing is still coming, and is shown as soon as it is whole.",
          remedies: ["dismiss"],
        });
      } else {
        notices.clear("degraded");
        shell.announcer.say(landedText(landed, isCompletion));
      }
      if (isCompletion) return;
      if (order.isEntry) link.push(routeNow());
      else link.follow(settledRoute);
    },
    setView(view) {
      const { store, camera, stand } = parts();
      const { landed } = store.get();
      if (view === "walk") camera.setView("walk", hasWalked ? camera.stood : stand(landed?.place ?? camera.focus));
      else camera.setView("orbit", null);
      moved();
    },
  };
}
