/** Going to places: landings that the user or the address asks for, and the address that follows. */

import type { LandOptions, Vec3 } from "../../core/types.ts";
import type { Stage } from "../../three/stage.ts";
import type { Announcer } from "../announcer.ts";
import { prefersLessMotion } from "../device.ts";
import { outsideNotice } from "../failures.ts";
import { formatBytes, formatCount, formatMs, formatRadius } from "../format.ts";
import { outsideBy } from "../reach.ts";
import { isSameLanding, type Route } from "../route.ts";
import type { CameraDesk } from "./camera-desk.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { LandingOrder } from "./landing-desk.ts";
import type { Markers } from "./markers.ts";
import type { Notices } from "./notices.ts";
import type { PlaceLink } from "./place-link.ts";
import { modeOf, placeOf, routeModeOf } from "./route-state.ts";
import type { Landed, ViewerStore } from "./state.ts";

/** Every way to a landing: a click, a link, the history, an embedding page. */
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

/** What going needs. */
export interface GoingOptions {
  readonly store: ViewerStore;
  readonly stage: Stage;
  readonly camera: CameraDesk;
  readonly markers: Markers;
  readonly notices: Notices;
  readonly link: PlaceLink;
  readonly loop: FrameLoop;
  readonly announcer: Announcer;
  /** Give an order to the landing desk; returns the landing's number. */
  readonly order: (order: LandingOrder, options?: LandOptions) => number;
  /** Where to stand at a place, or near it; the place itself where nobody could. */
  readonly stand: (at: Vec3) => Vec3;
}

/** Bind them to stage, camera and address; the first landing is the caller's. */
export function createGoing(options: GoingOptions): Going {
  const { store, stage, camera, markers, notices, link, loop, announcer, stand } = options;
  /** Since the newest landing the user has walked: to walk again is to go back to where he stood. */
  let hasWalked = false;
  let newest: LandingOrder | null = null;

  function land(order: LandingOrder, landOptions?: LandOptions): number {
    newest = order;
    notices.clear("landing");
    notices.clear("degraded");
    notices.clear("steep");
    sayIfOutside(order.position, order.radiusM);
    const landing = options.order(order, landOptions);
    loop.request();
    return landing;
  }

  /** Say that nothing can be at a place; whether that is so. */
  function sayIfOutside(position: Vec3, radiusM: number): boolean {
    const outsideM = outsideBy(position, radiusM, store.get().manifest.bounds);
    if (outsideM !== null) notices.show(outsideNotice(outsideM, radiusM));
    return outsideM !== null;
  }

  function routeNow(): Route {
    const { manifest, landed, mode } = store.get();
    return {
      scene: manifest.id,
      place: landed === null ? null : placeOf(landed, camera.look),
      mode: routeModeOf(mode, manifest),
    };
  }

  /** Null while the user is on his way: back or forward have put that place into the address, and there it stays. */
  function settledRoute(): Route | null {
    const { phase, position, radiusM } = stage.status;
    const { landed } = store.get();
    const isAtLanding =
      landed !== null && landed.radiusM === radiusM && position.every((value, axis) => value === landed.place[axis]);
    return isAtLanding || phase === "refused" ? routeNow() : null;
  }

  function isBeyondDetail(): boolean {
    const { landed } = store.get();
    const [x, , z] = camera.focus;
    return landed !== null && Math.hypot(x - landed.place[0], z - landed.place[2]) > landed.effectiveRadiusM;
  }

  function moved(): void {
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
      const { aim } = store.get();
      if (aim !== null) land({ position: aim.place, radiusM: aim.radiusM, look: null, isEntry: true });
    },
    follow(route, isEntry) {
      // The mode is taken in any case; a place that is shown already is only looked at, any other is landed on.
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
      land({ position: place.at, radiusM, look: place, isEntry });
    },
    arrived({ position, look }) {
      const { bringsCamera } = store.get();
      // On what is shown now: an aim was at what was shown before. Feet that a link tells stood there already.
      const walks = (look?.view ?? camera.view) === "walk" && (look?.focus ?? null) === null;
      const at = walks ? stand(position) : position;
      if (look !== null) camera.moveTo(at, look, false);
      else if (camera.view === "walk") camera.moveTo(at, null, false);
      else if (bringsCamera) camera.moveTo(position, null, true);
      hasWalked = camera.view === "walk";
      store.set({ view: camera.view, outside: false });
    },
    shown(landed, order, isCompletion) {
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
        announcer.announce(landedText(landed, isCompletion));
      }
      // The rest of a degraded landing: its entry of the history was written with the first swap.
      if (isCompletion) return;
      if (order.isEntry) link.push(routeNow());
      else link.follow(settledRoute);
    },
    setView(view) {
      const { landed } = store.get();
      if (view === "walk") camera.setView("walk", hasWalked ? camera.stood : stand(landed?.place ?? camera.focus));
      else camera.setView("orbit", null);
      moved();
    },
  };
}

/** A landing that was shown, in words. */
function landedText(landed: Landed, isCompletion: boolean): string {
  const size = `${formatCount(landed.triangles)} triangles within ${formatRadius(landed.effectiveRadiusM)}`;
  if (landed.degraded) return "The connection is slow: the middle of the landing is shown, the rest follows.";
  if (isCompletion) return `The landing is complete: ${size}.`;
  const bytes = landed.bytes === 0 ? "nothing had to be loaded" : `${formatBytes(landed.bytes)} loaded`;
  return `Landed: ${size}, ${bytes}, ready after ${formatMs(landed.readyMs)}.`;
}
