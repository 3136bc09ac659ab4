/** Picking and measuring for who wears the headset: the page's own tools, and what they found in a few lines. */

import { toSurvey } from "../../core/scene/survey.ts";
import type { RegionFacts, SceneManifest, Vec3 } from "../../core/types.ts";
import type { HeadsetMark, HeadsetTools } from "../../xr/types.ts";
import { formatCoordinate, formatDegrees, formatMetres, formatValue } from "../format.ts";
import { measurePath } from "../measure.ts";
import { regionName } from "../panel/look-tab.ts";
import type { GroundTools } from "./ground-tools.ts";
import type { Picked, ViewerStore } from "./state.ts";

/** Attributes of a picked point that a label has room for. */
const MAX_ATTRIBUTES = 4;

/** Where the tools look, and what they work by. */
export interface HeadsetToolOptions {
  readonly store: ViewerStore;
  readonly tools: Pick<GroundTools, "useRay">;
  readonly regions: readonly RegionFacts[];
}

/** The tools. What they find is in the store: it is still in the panel when the headset is taken off. */
export function headsetTools({ store, tools, regions }: HeadsetToolOptions): HeadsetTools {
  const pickedMark = kept((picked: Picked | null) =>
    picked === null ? null : markOfPick(picked, store.get().manifest, regions),
  );
  const measuredMark = kept(markOfPath);
  return {
    tool() {
      const { tool } = store.get();
      // Who paints does it on a screen.
      return tool === "brush" ? "land" : tool;
    },
    setTool: (tool) => store.set({ tool }),
    use: (origin, direction) => tools.useRay({ origin, direction }),
    clear: () => store.set({ picked: null, measured: [] }),
    picked: () => pickedMark(store.get().picked),
    measured: () => measuredMark(store.get().measured),
  };
}

/** What a function makes of a value, made once as long as that is the same. */
function kept<T, R>(make: (value: T) => R): (value: T) => R {
  let last: { readonly value: T; readonly made: R } | null = null;
  return (value) => {
    if (last === null || last.value !== value) last = { value, made: make(value) };
    return last.made;
  };
}

/** A picked point in words: what the page met at once, then the service's answer, which is of full detail. */
export function markOfPick(
  { place, region, answer }: Picked,
  manifest: SceneManifest,
  regions: readonly RegionFacts[],
): HeadsetMark {
  const found = typeof answer === "object" && answer !== null ? answer : null;
  const position = found?.position ?? place;
  const [east, north, height] = toSurvey(manifest, position);
  const name = found?.label ?? regionName(regions[found?.region ?? region]);
  const lines = [
    name,
    `East ${formatCoordinate(east)}`,
    `North ${formatCoordinate(north)}`,
    `Height ${formatCoordinate(height)}${manifest.surveyUnits === null ? " m" : ""}`,
  ];
  if (found !== null) {
    lines.push(`Slope ${formatDegrees(slopeDeg(found.normal))}`);
    const attributes = Object.entries(found.attributes).slice(0, MAX_ATTRIBUTES);
    lines.push(...attributes.map(([key, value]) => `${key} ${formatValue(value)}`));
  } else {
    lines.push(
      answer === null ? "Asking the service…" : answer === "none" ? "No full detail here" : "No answer just now",
    );
  }
  return { points: [position], lines };
}

/** A measured path in words; null without a point. */
export function markOfPath(measured: readonly Vec3[]): HeadsetMark | null {
  if (measured.length === 0) return null;
  const path = measurePath(measured);
  if (path === null) return { points: measured, lines: ["Point at the next place"] };
  const { straightM, horizontalM, heightDifferenceM, direct } = path;
  const lines = [
    formatMetres(straightM),
    `Horizontal ${formatMetres(horizontalM)}`,
    `Height ${heightDifferenceM > 0 ? "+" : ""}${formatMetres(heightDifferenceM)}`,
    `Slope ${formatDegrees(direct.slopeDeg)}`,
  ];
  if (measured.length > 2) lines.push(`${measured.length} points`);
  return { points: measured, lines };
}

/** Angle between a face and level ground. */
function slopeDeg(normal: Vec3): number {
  const size = Math.hypot(...normal);
  return size === 0 ? 0 : (Math.acos(Math.min(1, Math.abs(normal[1]) / size)) * 180) / Math.PI;
}
