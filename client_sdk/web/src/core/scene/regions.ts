/** regions.json and labels.json: what is known of the regions, and what people call them (scene format, section 11). */

import { PayloadError } from "../payload/errors.ts";
import type { JsonObject } from "../payload/json-values.ts";
import { expectList, expectObject } from "../payload/json-values.ts";
import type { RegionFacts, RegionPlace, Vec3 } from "../types.ts";

/** A label by stable id. */
export type Labels = ReadonlyMap<number, string>;

const LONGEST_LABEL = 256;

/**
 * Read the regions. Everything but their order is informative: a fact that is missing, or not what it should be, is null.
 *
 * @throws PayloadError If there is no list of regions, or an id is not the position in it.
 */
export function readRegions(json: unknown, labels: Labels): RegionFacts[] {
  const { regions } = expectObject(json, "regions.json");
  return expectList(regions, "regions").map((value, position) => {
    const region = expectObject(value, `region ${position}`);
    if (region.id !== position) throw new PayloadError(`region ${position} has another id, expected its position`);
    return readRegion(region, position, labels);
  });
}

/** Read labels.json. A file that is damaged gives no label at all: a name must never take the ground away. */
export function readLabels(json: unknown): Labels {
  const noLabels: Labels = new Map();
  if (typeof json !== "object" || json === null) return noLabels;
  const { format, format_version: version, labels: rows } = json as JsonObject;
  if (format !== "terraport-labels" || typeof version !== "string" || version.split(".")[0] !== "1") return noLabels;
  if (!Array.isArray(rows)) return noLabels;
  const labels = new Map<number, string>();
  let previousId = -1;
  for (const row of rows as readonly unknown[]) {
    const { stable_id: stableId, label } = (row ?? {}) as JsonObject;
    if (!isWhole(stableId) || stableId <= previousId || !isLabel(label)) return noLabels;
    labels.set(stableId, label);
    previousId = stableId;
  }
  return labels;
}

/** 1 to 256 code points, no control character, no blank at either end. */
function isLabel(value: unknown): value is string {
  if (typeof value !== "string" || value === "" || value !== value.trim() || /\p{Cc}/u.test(value)) return false;
  return [...value].length <= LONGEST_LABEL;
}

function readRegion(region: JsonObject, id: number, labels: Labels): RegionFacts {
  const stableId = isWhole(region.stable_id) ? region.stable_id : null;
  const labelled = stableId === null ? undefined : labels.get(stableId);
  const slope = region.slope_deg;
  return {
    id,
    stableId,
    label: labelled ?? (typeof region.label === "string" && region.label !== "" ? region.label : null),
    areaM2: numberOrNull(region.area_m2),
    meanColour: tripleOrNull(region.mean_colour),
    slopeDeg: typeof slope === "object" && slope !== null ? numberOrNull((slope as JsonObject).mean) : null,
    centroid: tripleOrNull(region.centroid),
    place: placeOrNull(region.place),
  };
}

function placeOrNull(value: unknown): RegionPlace | null {
  if (typeof value !== "object" || value === null) return null;
  const { position, heading_deg: heading, radius_m: radius } = value as JsonObject;
  const [at, headingDeg, radiusM] = [tripleOrNull(position), numberOrNull(heading), numberOrNull(radius)];
  return at === null || headingDeg === null || radiusM === null || radiusM <= 0
    ? null
    : { position: at, headingDeg, radiusM };
}

function isWhole(value: unknown): value is number {
  return typeof value === "number" && Number.isInteger(value) && value >= 0 && value <= 0xffffffff;
}

function numberOrNull(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

function tripleOrNull(value: unknown): Vec3 | null {
  if (!Array.isArray(value) || value.length !== 3) return null;
  const [x, y, z] = value.map(numberOrNull);
  return x == null || y == null || z == null ? null : [x, y, z];
}
