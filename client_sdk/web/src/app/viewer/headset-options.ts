/** What the headset is given of the page. */

import type { RegionFacts } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import { modesOf } from "../../three/view-modes.ts";
import type { HeadsetBookmark, HeadsetOptions, Standpoint } from "../../xr/types.ts";
import type { Bookmark } from "../bookmarks.ts";
import { regionsToVisit } from "../region-places.ts";
import { parseRoute, type Route } from "../route.ts";
import type { CameraDesk } from "./camera-desk.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { GroundTools } from "./ground-tools.ts";
import { headsetTools } from "./headset-tools.ts";
import type { Markers } from "./markers.ts";
import type { PlaceLink } from "./place-link.ts";
import type { ViewerStore } from "./state.ts";
import type { World } from "./world.ts";

/** Modules that the headset drives while it is worn; all stay the page's, and go on after the session. */
export interface PageForHeadset {
  readonly store: ViewerStore;
  readonly world: World;
  readonly stage: Terrain;
  readonly camera: CameraDesk;
  readonly markers: Markers;
  readonly loop: FrameLoop;
  readonly link: PlaceLink;
  /** The address of what is shown. */
  readonly routeNow: () => Route;
  readonly keptPlaces: () => readonly Bookmark[];
  readonly tools: Pick<GroundTools, "useRay">;
  readonly regions: readonly RegionFacts[];
}

/** Named regions among the places of the menu, four to a page. */
const MAX_REGIONS = 40;

/**
 * Make the headset's options from the page's modules. While it is worn the page's camera and landing desk rest; what the session
 * does is noted here, so that the page is where the user is when he takes it off.
 */
export function headsetOptions(page: PageForHeadset): HeadsetOptions {
  const { store, world, stage, camera, markers, loop, link, routeNow, keptPlaces, regions } = page;
  const modes = modesOf(store.get().manifest, regions).map(({ name, mode }) => ({ label: name, mode }));
  const named = regionsToVisit(store.get().manifest.id, regions, MAX_REGIONS).flatMap(bookmarkOf);
  const pageBudgetMs = stage.uploadBudgetMs;

  /** The page's own record of a landing that the headset made. */
  function noteLanding({ place: position, yawDeg }: Standpoint): void {
    const { status } = stage;
    const { plan } = status;
    const effectiveRadiusM = plan?.effectiveRadiusM ?? status.radiusM;
    store.set({
      landed: {
        place: status.position,
        radiusM: status.radiusM,
        effectiveRadiusM,
        coarseRadiusM: plan?.coarseRadiusM ?? null,
        segments: stage.shownSegments.length,
        triangles: plan?.totalTriangles ?? 0,
        bytes: status.payloadBytes,
        readyMs: status.readyMs,
        shownMs: status.presentableMs,
        degraded: status.phase !== "shown",
        missing: status.missing.length,
        omittedBy: plan?.omittedBy ?? null,
      },
    });
    camera.moveTo(position, { view: "walk", yawDeg, pitchDeg: -6, distanceM: null, focus: null }, false);
    link.push(routeNow());
  }

  return {
    renderer: world.renderer,
    scene: world.scene,
    rig: world.rig,
    camera: world.camera,
    landings: stage,
    radiusM: () => store.get().radiusM,
    start() {
      const { landed, view } = store.get();
      // From an orbit nobody is put in the air: he stands where he landed, or below where he looked.
      const position = view === "walk" ? camera.focus : (landed?.place ?? camera.focus);
      return { place: position, yawDeg: camera.yawDeg };
    },
    landed: noteLanding,
    ended(last) {
      store.set({ presenting: false });
      markers.setVisible(true);
      const { landed } = store.get();
      if (landed !== null) markers.setEdge(landed.place, landed.effectiveRadiusM);
      if (last !== null) {
        camera.moveTo(
          last.place,
          { view: "walk", yawDeg: last.yawDeg, pitchDeg: -6, distanceM: null, focus: null },
          false,
        );
        store.set({ view: "walk" });
      }
      loop.request();
    },
    setUploadBudgetMs(budgetMs) {
      stage.uploadBudgetMs = budgetMs ?? pageBudgetMs;
    },
    menu: {
      modes: () => modes,
      modeIndex() {
        const { mode } = store.get();
        return modes.findIndex(
          ({ mode: candidate }) =>
            candidate.kind === mode.kind &&
            (mode.kind !== "attribute" || (candidate.kind === "attribute" && candidate.name === mode.name)),
        );
      },
      setMode: (mode) => store.set({ mode }),
      setRadiusM: (radiusM) => store.set({ radiusM }),
      bookmarks: () => [...keptPlaces().flatMap(bookmarkOf), ...named],
    },
    tools: headsetTools({ store, tools: page.tools, regions }),
    setMiniature: (pose) => stage.setMiniature(pose),
  };
}

/** A place to land at; none where the address names no landing. */
function bookmarkOf({ name, hash }: Pick<Bookmark, "name" | "hash">): readonly HeadsetBookmark[] {
  const { place } = parseRoute(hash);
  return place === null ? [] : [{ label: name, place: place.at, yawDeg: place.yawDeg, radiusM: place.radiusM }];
}
