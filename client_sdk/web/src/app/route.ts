/**
 * The page's address: `#scene=ID&at=x,y,z&radius=60&look=yaw,pitch&view=walk&mode=regions`.
 *
 * Everything that makes a place is in the hash, so that a link, a bookmark and the browser's history are one thing. A token
 * never is. Parsing takes any text: what it does not understand it leaves out.
 */

import type { Vec3 } from "../core/types.ts";
import type { ViewMode } from "../three/types.ts";

/** How the user looks: turning about a point, or standing on the ground. */
export type ViewKind = "orbit" | "walk";

/** A landing and how it is looked at. Angles in degrees: yaw is a compass azimuth (0 north, 90 east), pitch up positive. */
export interface Place {
  readonly at: Vec3;
  readonly radiusM: number | null;
  readonly view: ViewKind | null;
  readonly yawDeg: number | null;
  readonly pitchDeg: number | null;
  /** Orbit only: from the eye to the point that it turns about. */
  readonly distanceM: number | null;
  /** Where the user stands (walk) or what the eye turns about (orbit), where that is not `at`. */
  readonly focus: Vec3 | null;
}

/** How a place is looked at. */
export type Look = Omit<Place, "at" | "radiusM">;

/** What the hash says. */
export interface Route {
  readonly scene: string | null;
  readonly place: Place | null;
  /** How the scene is looked at where nobody has landed: the address then has a look and a focus, and no `at`. */
  readonly look?: Look;
  readonly mode: RouteMode | null;
}

/** A mode as the address has it: an attribute's range may be left to the scene. */
export type RouteMode =
  | Exclude<ViewMode, { readonly kind: "attribute" }>
  | { readonly kind: "attribute"; readonly name: string; readonly range: readonly [number, number] | null };

const PLAIN_MODES = ["colour", "vertex-colour", "regions", "names", "segments", "slope"] as const;

/** Coordinates and radii beyond these are not valid on the wire either. */
const MAX_COORDINATE_M = 1e7;
const MAX_RADIUS_M = 1e6;

/** Read a hash, with or without `#`. */
export function parseRoute(hash: string): Route {
  const fields = new URLSearchParams(hash.replace(/^#/, ""));
  const place = parsePlace(fields);
  const look = parseLook(fields);
  return {
    scene: fields.get("scene") || null,
    place,
    ...(place === null && look.focus !== null && { look }),
    mode: parseMode(fields),
  };
}

/** Write a hash with its `#`. Commas stay readable; names are escaped. */
export function formatRoute(route: Route): string {
  const fields: string[] = [];
  if (route.scene !== null) fields.push(`scene=${encodeURIComponent(route.scene)}`);
  if (route.place !== null) fields.push(...formatPlace(route.place));
  else if (route.look !== undefined) fields.push(...formatLook(route.look));
  if (route.mode !== null) fields.push(...formatMode(route.mode));
  return `#${fields.join("&")}`;
}

/** The address of a scene without a place. */
export function sceneRoute(scene: string): Route {
  return { scene, place: null, mode: null };
}

/** A position as an address says it: who comes back by link or history asks for the very landing that a click asked for. */
export function asAddressed([x, y, z]: Vec3): Vec3 {
  return [Number(rounded(x, 2)), Number(rounded(y, 2)), Number(rounded(z, 2))];
}

/** Whether two places ask for the same landing; how it is looked at does not count. */
export function isSameLanding(a: Place | null, b: Place | null): boolean {
  if (a === null || b === null) return a === b;
  return a.radiusM === b.radiusM && a.at.every((value, axis) => Math.abs(value - b.at[axis]!) < 0.005);
}

function parsePlace(fields: URLSearchParams): Place | null {
  const at = parsePoint(fields.get("at"));
  if (at === null) return null;
  const radiusM = within(parseNumber(fields.get("radius")), Number.MIN_VALUE, MAX_RADIUS_M);
  return { at, radiusM, ...parseLook(fields) };
}

function parseLook(fields: URLSearchParams): Look {
  const look = parseNumbers(fields.get("look"), 2);
  const view = fields.get("view");
  return {
    view: view === "walk" || view === "orbit" ? view : null,
    yawDeg: look === null ? null : wrapDegrees(look[0]!),
    pitchDeg: look === null ? null : Math.min(90, Math.max(-90, look[1]!)),
    distanceM: within(parseNumber(fields.get("distance")), Number.MIN_VALUE, MAX_COORDINATE_M),
    focus: parsePoint(fields.get("focus")),
  };
}

function formatPlace(place: Place): string[] {
  const fields = [`at=${point(place.at)}`];
  if (place.radiusM !== null) fields.push(`radius=${rounded(atLeastACentimetre(place.radiusM), 2)}`);
  return [...fields, ...formatLook(place)];
}

function formatLook(place: Look): string[] {
  const fields: string[] = [];
  if (place.yawDeg !== null && place.pitchDeg !== null) {
    fields.push(`look=${rounded(wrapDegrees(place.yawDeg), 1)},${rounded(place.pitchDeg, 1)}`);
  }
  if (place.distanceM !== null) fields.push(`distance=${rounded(atLeastACentimetre(place.distanceM), 2)}`);
  if (place.focus !== null) fields.push(`focus=${point(place.focus)}`);
  if (place.view !== null) fields.push(`view=${place.view}`);
  return fields;
}

function parseMode(fields: URLSearchParams): RouteMode | null {
  const kind = fields.get("mode");
  for (const plain of PLAIN_MODES) {
    if (kind === plain) return { kind: plain };
  }
  const name = fields.get("attribute");
  if (kind !== "attribute" || !name) return null;
  const range = parseNumbers(fields.get("range"), 2);
  const ordered = range !== null && range[0]! < range[1]!;
  return { kind: "attribute", name, range: ordered ? [range[0]!, range[1]!] : null };
}

function formatMode(mode: RouteMode): string[] {
  if (mode.kind !== "attribute") return [`mode=${mode.kind}`];
  const fields = ["mode=attribute", `attribute=${encodeURIComponent(mode.name)}`];
  if (mode.range !== null)
    fields.push(`range=${Number(mode.range[0].toPrecision(6))},${Number(mode.range[1].toPrecision(6))}`);
  return fields;
}

function parsePoint(text: string | null): Vec3 | null {
  const numbers = parseNumbers(text, 3);
  if (numbers === null || numbers.some((value) => Math.abs(value) > MAX_COORDINATE_M)) return null;
  return [numbers[0]!, numbers[1]!, numbers[2]!];
}

function parseNumbers(text: string | null, count: number): number[] | null {
  const numbers = (text ?? "").split(",").map(parseNumber);
  return numbers.length === count && numbers.every((value) => value !== null) ? (numbers as number[]) : null;
}

function parseNumber(text: string | null): number | null {
  // Number("") is 0, and Number("0x10") is 16: only decimal numbers are meant.
  return text !== null && /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(text) && Number.isFinite(Number(text))
    ? Number(text)
    : null;
}

function within(value: number | null, min: number, max: number): number | null {
  return value !== null && value >= min && value <= max ? value : null;
}

/** A length above 0 must not be rounded to 0, which is none. */
function atLeastACentimetre(metres: number): number {
  return Math.max(0.01, metres);
}

function wrapDegrees(degrees: number): number {
  return ((degrees % 360) + 360) % 360;
}

function point(position: Vec3): string {
  return position.map((value) => rounded(value, 2)).join(",");
}

function rounded(value: number, digits: number): string {
  // Number() drops trailing zeros; adding 0 turns -0 into 0.
  return String(Number(value.toFixed(digits)) + 0);
}
