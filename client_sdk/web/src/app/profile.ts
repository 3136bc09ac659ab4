/**
 * The ground along a measured path, and the files that people carry away. PURE. Frame: Y is up.
 *
 * The files have the form of `terraport export --as section`: the same columns, the same layers.
 */

import type { Vec3 } from "../core/types.ts";

/** Ground at one place of the path. */
export interface ProfilePoint {
  /** Along the path, seen from above. */
  readonly distanceM: number;
  readonly position: Vec3;
}

/** Pieces of ground: a new one begins behind every gap. */
export type Profile = readonly (readonly ProfilePoint[])[];

/** Turns a position of the scene into easting, northing, height of the survey. */
export type ToSurvey = (position: Vec3) => readonly [number, number, number];

/** Places looked at along a path, at most: each is a ray through the shown ground. */
export const MAX_PLACES = 1000;
/** No closer than this: below it a survey has no ground to tell. */
const LEAST_STEP_M = 0.02;

/** Look at the ground along a path, corners included; `heightAt` is null where there is none. */
export function profileAlong(path: readonly Vec3[], heightAt: (x: number, z: number) => number | null): Profile {
  const legs = path.slice(1).map((to, index) => {
    const from = path[index]!;
    return { from, to, lengthM: Math.hypot(to[0] - from[0], to[2] - from[2]) };
  });
  const totalM = legs.reduce((sum, leg) => sum + leg.lengthM, 0);
  if (totalM === 0) return [];
  const stepM = Math.max(LEAST_STEP_M, totalM / Math.max(1, MAX_PLACES - legs.length));
  const pieces: ProfilePoint[][] = [];
  let piece: ProfilePoint[] | null = null;
  const look = (x: number, z: number, distanceM: number): void => {
    const y = heightAt(x, z);
    if (y === null) {
      piece = null;
      return;
    }
    if (piece === null) {
      piece = [];
      pieces.push(piece);
    }
    piece.push({ distanceM, position: [x, y, z] });
  };
  const [x, , z] = path[0]!;
  look(x, z, 0);
  let walkedM = 0;
  for (const { from, to, lengthM } of legs) {
    if (lengthM === 0) continue;
    const steps = Math.max(1, Math.floor(lengthM / stepM));
    for (let step = 1; step <= steps; step += 1) {
      const share = step / steps;
      look(from[0] + share * (to[0] - from[0]), from[2] + share * (to[2] - from[2]), walkedM + share * lengthM);
    }
    walkedM += lengthM;
  }
  return pieces.filter((points) => points.length > 1);
}

/** Rows of line, distance, easting, northing, height; distance in metres, the rest in the survey's units. */
export function profileCsv(profile: Profile, toSurvey: ToSurvey): string {
  const rows = profile.flatMap((points, index) =>
    points.map(({ distanceM, position }) =>
      [String(index + 1), ...[distanceM, ...toSurvey(position)].map((value) => value.toFixed(4))].join(","),
    ),
  );
  return ["line,distance,easting,northing,height", ...rows, ""].join("\n");
}

/**
 * A drawing of release 12, which every CAD program reads: the ground as polylines where it is (layer SECTION), and as
 * distance and height beside it (layer PROFILE, off).
 */
export function profileDxf(profile: Profile, toSurvey: ToSurvey): string {
  const layers = [layer("SECTION", 7), layer("PROFILE", -7)];
  const lines = profile.flatMap((points) => [
    polyline(
      "SECTION",
      points.map(({ position }) => toSurvey(position)),
    ),
    polyline(
      "PROFILE",
      points.map(({ distanceM, position }) => [distanceM, toSurvey(position)[2], 0]),
    ),
  ]);
  return [
    group(0, "SECTION", 2, "HEADER", 9, "$ACADVER", 1, "AC1009", 0, "ENDSEC"),
    group(0, "SECTION", 2, "TABLES", 0, "TABLE", 2, "LAYER", 70, layers.length),
    ...layers,
    group(0, "ENDTAB", 0, "ENDSEC", 0, "SECTION", 2, "ENTITIES"),
    ...lines,
    group(0, "ENDSEC", 0, "EOF"),
    "",
  ].join("\n");
}

/** A negative colour turns a layer off. */
function layer(name: string, colour: number): string {
  return group(0, "LAYER", 2, name, 70, 0, 62, colour, 6, "CONTINUOUS");
}

function polyline(name: string, points: readonly (readonly number[])[]): string {
  const threeDimensional = 8;
  return [
    group(0, "POLYLINE", 8, name, 66, 1, 10, "0.0", 20, "0.0", 30, "0.0", 70, threeDimensional),
    ...points.map(([x, y, z]) =>
      group(0, "VERTEX", 8, name, 10, decimal(x!), 20, decimal(y!), 30, decimal(z!), 70, 4 * threeDimensional),
    ),
    group(0, "SEQEND", 8, name),
  ].join("\n");
}

function decimal(value: number): string {
  return value.toFixed(4);
}

/** Codes and values, a line each. */
function group(...pairs: readonly (string | number)[]): string {
  return pairs.map((part, index) => (index % 2 === 0 ? String(part).padStart(3) : String(part))).join("\n");
}
