/** regions.json and labels.json: what is known of the regions, and what people call them (scene format, section 11). */

import { PayloadError } from "../payload/errors.ts";
import type { CoarserPiece, RegionFacts, RegionPlace, RegionUnion, Vec3 } from "../types.ts";
import type { JsonObject } from "./json-values.ts";
import { expectList, expectObject } from "./json-values.ts";

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

/** What unites regions to coarser pieces; up to the first that is not as it should be. */
export function readUnions(json: unknown): readonly RegionUnion[] {
  const { regions, unions } = expectObject(json, "regions.json");
  if (!Array.isArray(unions) || !Array.isArray(regions)) return [];
  const good: RegionUnion[] = [];
  for (const union of unions as readonly unknown[]) {
    if (!Array.isArray(union) || union.length !== 3) break;
    const [one, other, cost] = union as readonly unknown[];
    const pieces = regions.length + good.length;
    if (!isWhole(one) || !isWhole(other) || one >= other || other >= pieces || numberOrNull(cost) === null) break;
    good.push([one, other, cost as number]);
  }
  return good;
}

/** The pieces that a region is part of, finest first: one for each cost at which more is united. */
export function coarserPieces(
  regions: readonly RegionFacts[],
  unions: readonly RegionUnion[],
  region: number,
): readonly CoarserPiece[] {
  let at = region;
  const membersOf = new Map<number, readonly number[]>();
  const pieces = new Map<number, readonly number[]>();
  const take = (piece: number): readonly number[] => {
    const members = membersOf.get(piece) ?? [piece];
    membersOf.delete(piece);
    return members;
  };
  unions.forEach(([one, other, cost], place) => {
    const united = [...take(one), ...take(other)];
    membersOf.set(regions.length + place, united);
    if (at !== one && at !== other) return;
    at = regions.length + place;
    pieces.set(cost, united);
  });
  return [...pieces].map(([cost, ids]) => describePiece(regions, cost, ids));
}

/** Called what most of its named ground is called. */
function describePiece(regions: readonly RegionFacts[], cost: number, ids: readonly number[]): CoarserPiece {
  const areaOfName = new Map<string, number>();
  let areaM2 = 0;
  for (const id of ids) {
    const { label, areaM2: own } = regions[id]!;
    areaM2 += own ?? 0;
    if (label !== null) areaOfName.set(label, (areaOfName.get(label) ?? 0) + (own ?? 0));
  }
  const [largest] = [...areaOfName].sort(([a, m], [b, n]) => n - m || (a < b ? 1 : -1));
  return { cost, regions: [...ids].sort((a, b) => a - b), areaM2, label: largest?.[0] ?? null };
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
