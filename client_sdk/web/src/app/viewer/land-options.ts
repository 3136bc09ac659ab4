/** What the page asks for with a landing, by what the user has chosen. PURE. */

import { coarseRadiusOf, waitingOf } from "../../core/landing-defaults.ts";
import type { TerrainLandOptions } from "../../three/types.ts";
import type { ViewerState } from "./state.ts";

type Chosen = Pick<ViewerState, "manifest" | "showsCoarse">;

/** How far a landing of this radius shows the coarser level; undefined where the scene has none, or nobody wants it. */
export function coarseRadiusIn({ manifest, showsCoarse }: Chosen, radiusM: number): number | undefined {
  return showsCoarse ? coarseRadiusOf(radiusM, manifest) : undefined;
}

/** Options of a landing of this radius. */
export function landOptionsIn(state: Chosen, radiusM: number, inHeadset: boolean): TerrainLandOptions {
  return { ...waitingOf(radiusM, inHeadset), coarseRadiusM: coarseRadiusIn(state, radiusM) ?? null };
}
