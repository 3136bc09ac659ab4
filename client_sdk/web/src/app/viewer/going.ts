/** Going to places: landings that the user or the address asks for, and the address that follows. */

import { outsideBy } from "../../core/landing-defaults.ts";
import type { LandOptions, Vec3 } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import type { LandingStatus } from "../../three/types.ts";
import type { Announcer } from "../announcer.ts";
import { prefersLessMotion } from "../device.ts";
import { outsideNotice, steepNotice } from "../failures.ts";
import { formatBytes, formatCount, formatMs, formatReach } from "../format.ts";
import { isSameLanding, type Look, type Place, type Route } from "../route.ts";
import { EYE_HEIGHT_M, openYaw } from "../walk-pose.ts";
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
  /** The promise is that of `Terrain.land`. */
  land(order: LandingOrder, options?: LandOptions): Promise<LandingStatus>;
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
  readonly stage: Terrain;
  readonly camera: CameraDesk;
  readonly markers: Markers;
  readonly notices: Notices;
  readonly link: PlaceLink;
  readonly loop: FrameLoop;
  readonly announcer: Announcer;
  /** Give an order to the landing desk. */
  readonly order: (order: LandingOrder, options?: LandOptions) => Promise<LandingStatus>;
  /** Where to stand at a place, or near it; null where nobody could. */
  readonly stand: (at: Vec3) => Vec3 | null;
  /** Whether who stood there would have his eye inside the rock. */
  readonly isBuried: (feet: Vec3) => boolean;
}

/** Who sees so far stands before no wall, metres. */
const SIGHT_M = 50;
/** Whoever comes down from above looks a little down. */
const ARRIVAL_PITCH_DEG = -8;

/** Bind them to stage, camera and address; the first landing is the caller's. */
export function createGoing(options: GoingOptions): Going {
  const { store, stage, camera, markers, notices, link, loop, announcer, stand, isBuried } = options;
  /** Since the newest landing the user has walked: to walk again is to go back to where he stood. */
  let hasWalked = false;
  let newest: LandingOrder | null = null;

  function land(order: LandingOrder, landOptions?: LandOptions): Promise<LandingStatus> {
    newest = order;
    notices.clear("landing");
    notices.clear("degraded");
    notices.clear("ground");
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
      ...(landed === null && !camera.isHome && { look: camera.look }),
      mode: routeModeOf(mode, manifest),
    };
  }

  /** Null while the user is on his way: back or forward have put that place into the address, and there it stays. */
  function settledRoute(): Route | null {
    const { phase, position, radiusM } = stage.status;
    const { landed } = store.get();
    // Before the first landing the look alone is the place.
    if (phase === "idle") return routeNow();
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
    link.follow(settledRoute);
    loop.request();
  }

  /** Put the user on the ground at a place, or beside it; false where nobody could stand: he stays where he is. */
  function standAt(position: Vec3, look: Look | null, glides: boolean): boolean {
    // Feet that a link tells stood there already; but ground changes, and links are written by hand, too.
    const told = look?.focus ?? null;
    const at = told !== null && !isBuried(told) ? told : stand(position);
    if (at === null) {
      notices.show(steepNotice(camera.view === "walk"));
      return false;
    }
    const isFromAbove = camera.view !== "walk";
    const yawDeg = look?.yawDeg ?? (isFromAbove ? openYaw(camera.yawDeg, sightAt(at)) : camera.yawDeg);
    const pitchDeg = look?.pitchDeg ?? (isFromAbove ? ARRIVAL_PITCH_DEG : null);
    camera.moveTo(at, { view: "walk", yawDeg, pitchDeg, distanceM: null, focus: null }, glides && isFromAbove);
    return true;
  }

  /** How far one sees who stands there, by where he looks. */
  function sightAt([x, y, z]: Vec3): (yawDeg: number) => number {
    return (yawDeg) => {
      const yaw = (yawDeg * Math.PI) / 180;
      const ahead: Vec3 = [Math.sin(yaw), 0, -Math.cos(yaw)];
      return stage.cast([x, y + EYE_HEIGHT_M, z], ahead, SIGHT_M)?.distanceM ?? Number.POSITIVE_INFINITY;
    };
  }

  /** Look at a place as an address says. */
  function lookAt(position: Vec3, look: Look, glides: boolean): void {
    if ((look.view ?? camera.view) !== "walk") camera.moveTo(position, look, glides);
    else if (!standAt(position, look, false)) camera.moveTo(position, { ...look, view: "orbit" }, false);
  }

  /** The ground under the walker has changed: on it, not in it. */
  function stayOnGround(): void {
    if (camera.view === "walk") camera.moveTo(camera.stood, null, false);
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
      if (aim !== null) land({ position: aim.place, radiusM: aim.radiusM, look: null, isEntry: true, goes: true });
    },
    follow(route, isEntry) {
      // The mode is taken in any case; a place that is shown already is only looked at, any other is landed on.
      const { manifest, landed } = store.get();
      store.set({ mode: modeOf(route.mode, manifest) });
      const { place } = route;
      if (place === null) {
        if (route.look?.focus != null && landed === null) {
          lookAt(route.look.focus, route.look, false);
          moved();
        }
        return;
      }
      const radiusM = place.radiusM ?? store.get().radiusM;
      store.set({ radiusM });
      // Nobody is led out of the scene by a link: what is shown stays.
      if (sayIfOutside(place.at, radiusM)) return;
      if (landed !== null && isSameLanding(place, placeOf(landed, camera.look))) {
        lookAt(place.at, place, !prefersLessMotion());
        moved();
        return;
      }
      // Who opens a link sees the place at once, and its detail when it is here.
      if (landed === null && isLooked(place)) lookAt(place.at, place, false);
      land({ position: place.at, radiusM, look: place, isEntry, goes: false });
    },
    arrived({ position, look, goes }) {
      // On what is shown now: an aim was at what was shown before.
      if (look !== null) lookAt(position, look, false);
      else if (camera.view === "walk" || (goes && store.get().bringsCamera)) {
        if (!standAt(position, null, goes)) stayOnGround();
      }
      if (goes) stage.markFresh();
      hasWalked = camera.view === "walk";
      store.set({ view: camera.view, outside: false });
    },
    shown(landed, order, isCompletion) {
      markers.setEdge(landed.place, landed.effectiveRadiusM);
      // After the frame of the swap: it walks the whole base.
      window.setTimeout(() => store.set({ gain: stage.gain() }));
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
      if (view !== "walk") camera.setView("orbit");
      else if (hasWalked && !isBuried(camera.stood)) camera.moveTo(camera.stood, { ...NO_LOOK, view }, true);
      else standAt(landed?.place ?? camera.focus, null, true);
      moved();
    },
  };
}

const NO_LOOK: Look = { view: null, yawDeg: null, pitchDeg: null, distanceM: null, focus: null };

/** Whether an address says more than where the landing is. */
function isLooked(place: Place): boolean {
  return place.yawDeg !== null || place.distanceM !== null || place.focus !== null;
}

/** A landing that was shown, in words. */
function landedText(landed: Landed, isCompletion: boolean): string {
  const size = `${formatCount(landed.triangles)} triangles within ${formatReach(landed)}`;
  if (landed.degraded) return "The connection is slow: the middle of the landing is shown, the rest follows.";
  if (isCompletion) return `The landing is complete: ${size}.`;
  const bytes = landed.bytes === 0 ? "nothing had to be loaded" : `${formatBytes(landed.bytes)} loaded`;
  const ready = landed.readyMs === null ? "shown at once" : `ready after ${formatMs(landed.readyMs)}`;
  return `Landed: ${size}, ${bytes}, ${ready}.`;
}
