/** From the scene's frame to the survey's coordinates (scene format, sections 3 and 4). */

import type { SceneManifest, Vec3 } from "../types.ts";

/** East, north, height as the survey has them, in its own units, in float64. */
export function toSurvey(
  manifest: Pick<SceneManifest, "origin" | "surveyUnits">,
  position: Vec3,
): [number, number, number] {
  const [east, north, height] = manifest.origin;
  const { horizontalM, heightM } = manifest.surveyUnits ?? { horizontalM: 1, heightM: 1 };
  return [(east + position[0]) / horizontalM, (north - position[2]) / horizontalM, (height + position[1]) / heightM];
}
