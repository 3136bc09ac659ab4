/** From the scene's frame to the survey's coordinates and back (scene format, sections 3 and 4). */

import type { SceneManifest, Vec3 } from "../types.ts";

type Frame = Pick<SceneManifest, "origin" | "surveyUnits">;

/** East, north, height as the survey has them, in its own units, in float64. */
export function toSurvey(manifest: Frame, position: Vec3): [number, number, number] {
  const [east, north, height] = manifest.origin;
  const { horizontalM, heightM } = unitsOf(manifest);
  return [(east + position[0]) / horizontalM, (north - position[2]) / horizontalM, (height + position[1]) / heightM];
}

/** x, y, z in the scene's frame, metres, of a point as the survey has it. */
export function fromSurvey(manifest: Frame, survey: Vec3): [number, number, number] {
  const [east, north, height] = manifest.origin;
  const { horizontalM, heightM } = unitsOf(manifest);
  // Not -(n - n0): that would make a minus zero of the origin itself.
  return [survey[0] * horizontalM - east, survey[2] * heightM - height, north - survey[1] * horizontalM];
}

function unitsOf(manifest: Frame): NonNullable<SceneManifest["surveyUnits"]> {
  return manifest.surveyUnits ?? { horizontalM: 1, heightM: 1 };
}
