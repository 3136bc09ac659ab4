/** From the scene's frame to the survey's coordinates (scene format, sections 3 and 4). */

import type { SceneManifest, SurveyAxis, Vec3 } from "../types.ts";

/** Column of easting, northing, height, and sign, by the direction in which a coordinate counts. */
const DIRECTIONS: Readonly<Record<SurveyAxis, readonly [0 | 1 | 2, 1 | -1]>> = {
  east: [0, 1],
  west: [0, -1],
  north: [1, 1],
  south: [1, -1],
  up: [2, 1],
  down: [2, -1],
};

export function isSurveyAxis(value: unknown): value is SurveyAxis {
  return typeof value === "string" && Object.hasOwn(DIRECTIONS, value);
}

/** Coordinates as the survey has them (mostly easting, northing, height), in its own units, in float64. */
export function toSurvey(
  manifest: Pick<SceneManifest, "origin" | "surveyUnits">,
  position: Vec3,
): [number, number, number] {
  const [east, north, height] = manifest.origin;
  const { horizontalM, heightM, axes } = manifest.surveyUnits ?? { horizontalM: 1, heightM: 1 };
  const metres = [east + position[0], north - position[2], height + position[1]] as const;
  const along = (axis: SurveyAxis, unitM: number): number => {
    const [column, sign] = DIRECTIONS[axis];
    return (sign * metres[column]) / unitM;
  };
  const [x, y, z] = axes ?? (["east", "north", "up"] as const);
  return [along(x, horizontalM), along(y, horizontalM), along(z, heightM)];
}
