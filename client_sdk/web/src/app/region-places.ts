/** Named regions as places to go to. */

import type { RegionFacts } from "../core/types.ts";
import { formatRoute } from "./route.ts";

/** Who stands before a region looks a little down at it. */
const PITCH_DEG = -6;

/** A named region, and the address of the landing that shows it. */
export interface RegionToVisit {
  readonly name: string;
  readonly areaM2: number | null;
  /** With `#`. */
  readonly hash: string;
}

/** Regions with a name by name, the largest of each first; `most` of them. */
export function regionsToVisit(scene: string, regions: readonly RegionFacts[], most: number): RegionToVisit[] {
  return regions
    .flatMap((region) => {
      const hash = region.label === null ? null : hashOf(scene, region);
      return region.label === null || hash === null ? [] : [{ name: region.label, areaM2: region.areaM2, hash }];
    })
    .sort((a, b) => a.name.localeCompare(b.name) || (b.areaM2 ?? 0) - (a.areaM2 ?? 0))
    .slice(0, most);
}

/** Where it is seen best; else its middle, looked at as one likes. */
function hashOf(scene: string, { place, centroid }: RegionFacts): string | null {
  const at = place?.position ?? centroid;
  if (at === null) return null;
  return formatRoute({
    scene,
    mode: null,
    place: {
      at,
      radiusM: place?.radiusM ?? null,
      view: place === null ? null : "walk",
      yawDeg: place?.headingDeg ?? null,
      pitchDeg: place === null ? null : PITCH_DEG,
      distanceM: null,
      focus: null,
    },
  });
}
