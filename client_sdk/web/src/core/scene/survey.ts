/** From the scene's frame to the survey's coordinates and back (scene format, section 3). */

import type { SceneManifest, Vec3 } from "../types.ts";

/** East, north, height in the survey's CRS, metres, in float64. */
export function toSurvey(manifest: Pick<SceneManifest, "origin">, position: Vec3): [number, number, number] {
  const [east, north, height] = manifest.origin;
  return [east + position[0], north - position[2], height + position[1]];
}

/** x, y, z in the scene's frame, metres, of a point in the survey's CRS. */
export function fromSurvey(manifest: Pick<SceneManifest, "origin">, survey: Vec3): [number, number, number] {
  const [east, north, height] = manifest.origin;
  // Not -(n - n0): that would make a minus zero of the origin itself.
  return [survey[0] - east, survey[2] - height, north - survey[1]];
}
