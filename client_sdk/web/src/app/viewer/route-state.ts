/** Between the address and the viewer's state. PURE. */

import { defaultRadiusM } from "../../core/landing-defaults.ts";
import type { SceneManifest } from "../../core/types.ts";
import type { ViewMode } from "../../three/types.ts";
import { attributeMode } from "../../three/view-modes.ts";
import type { Look, Place, RouteMode } from "../route.ts";
import { shortPlace } from "./place-link.ts";
import type { Landed, ViewerState } from "./state.ts";
import type { ViewerOptions } from "./viewer-options.ts";

/** The state before anything has happened. */
export function firstState({ files, budgets, route }: ViewerOptions): ViewerState {
  const { manifest } = files;
  return {
    manifest,
    link: null,
    view: "orbit",
    tool: "land",
    mode: modeOf(route.mode, manifest),
    highlightedRegion: null,
    radiusM: route.place?.radiusM ?? defaultRadiusM(manifest, budgets),
    showsCoarse: true,
    maxRadiusM: null,
    landing: null,
    landed: null,
    aim: null,
    picked: null,
    measured: [],
    bringsCamera: true,
    gain: null,
    split: null,
    group: null,
    groupProblem: null,
    follows: true,
    // Beside the picture there is room for it; on a phone it would cover what the user came to see.
    panelOpen: window.matchMedia("(min-width: 60rem) and (min-height: 30rem)").matches,
    tab: "landing",
    outside: false,
    presenting: false,
    contextLost: false,
    swaps: 0,
    visibleChanges: 0,
    strayChanges: 0,
  };
}

/** The mode that an address asks for; the survey's own look where the scene has no such thing. */
export function modeOf(mode: RouteMode | null, manifest: SceneManifest): ViewMode {
  if (mode === null) return { kind: "colour" };
  if (mode.kind === "vertex-colour" && manifest.texturesOf === null) return { kind: "colour" };
  if (mode.kind !== "attribute") return mode;
  const info = manifest.attributes.find(({ name }) => name === mode.name);
  if (info === undefined) return { kind: "colour" };
  if (mode.range !== null) return { kind: "attribute", name: mode.name, min: mode.range[0], max: mode.range[1] };
  return attributeMode(info.name, info.min, info.max);
}

/** The mode as an address has it: null for what is shown without one, no range where it is the scene's own. */
export function routeModeOf(mode: ViewMode, manifest: SceneManifest): RouteMode | null {
  if (mode.kind === "colour") return null;
  if (mode.kind !== "attribute") return mode;
  const info = manifest.attributes.find(({ name }) => name === mode.name);
  const isWhole = info !== undefined && mode.min === info.min && mode.max === info.max;
  return { kind: "attribute", name: mode.name, range: isWhole ? null : [mode.min, mode.max] };
}

/** A landing and how it is looked at, as an address. */
export function placeOf(landed: Landed, look: Look): Place {
  return shortPlace({ at: landed.place, radiusM: landed.radiusM, ...look });
}
