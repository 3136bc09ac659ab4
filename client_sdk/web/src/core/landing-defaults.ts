/** What is asked for with a landing where nobody says otherwise, and whether one can meet the scene at all. PURE. */

import type { DeviceBudgets } from "./budgets.ts";
import type { Bounds, LandOptions, SceneManifest, Vec3 } from "./types.ts";

/** Of the way across the scene: a landing shows its edge, and one sees what it brought. */
const SHARE_OF_SCENE = 0.25;
/** Of the triangles that the device can draw: the next scene is not the last. */
const SHARE_OF_TRIANGLES = 0.5;
/** Less is not a place but a stone. */
const MIN_RADIUS_M = 1;

/**
 * The radius of a landing unless the user chooses another: what is right for the device, or less where the scene is small or
 * so dense that it could not be drawn.
 */
export function defaultRadiusM(
  { bounds, detailFaces }: Pick<SceneManifest, "bounds" | "detailFaces">,
  { radiusM, maxTriangles }: Pick<DeviceBudgets, "radiusM" | "maxTriangles">,
): number {
  const [eastM, southM] = [bounds[3] - bounds[0], bounds[5] - bounds[2]];
  const acrossM = Math.hypot(eastM, southM) * SHARE_OF_SCENE;
  const trianglesPerM2 = detailFaces / Math.max(eastM * southM, Number.MIN_VALUE);
  const drawnM = Math.sqrt((SHARE_OF_TRIANGLES * maxTriangles) / Math.max(trianglesPerM2 * Math.PI, Number.MIN_VALUE));
  const exact = Math.max(MIN_RADIUS_M, Math.min(radiusM, acrossM, drawnM));
  // A round number, as the slider has them.
  return exact < 10 ? Math.floor(exact * 2) / 2 : exact < 20 ? Math.floor(exact) : Math.floor(exact / 5) * 5;
}

/** Metres from a place to the box around the scene, where that is beyond the radius: nothing can be there. Else null. */
export function outsideBy(position: Vec3, radiusM: number, bounds: Bounds): number | null {
  const beyond = [0, 1, 2].map((axis) =>
    Math.max(bounds[axis]! - position[axis]!, 0, position[axis]! - bounds[axis + 3]!),
  );
  const distanceM = Math.hypot(...beyond);
  return distanceM > radiusM ? distanceM : null;
}

/**
 * After so long without any progress, or so long in all, the inner part of a landing is shown alone. A user who waits longer
 * than this thinks that the page is broken; one who sees where he stands does not mind the rim.
 */
const STALL_MS = 3000;
const DEADLINE_MS = 12_000;
/** In a headset the user stands in a place that he wanted to leave: he waits less. */
const HEADSET_DEADLINE_MS = 6000;
const INNER_PART = 0.35;
/** Times the radius: as far as the coarser level is worth its bytes (docs/benchmarks.md). */
const COARSE_REACH = 3;

/** How long a landing waits before its inner part is shown alone. */
export function waitingOf(
  radiusM: number,
  inHeadset: boolean,
): Required<Pick<LandOptions, "innerRadiusM" | "deadlineMs" | "stallMs">> {
  return {
    innerRadiusM: radiusM * INNER_PART,
    deadlineMs: inHeadset ? HEADSET_DEADLINE_MS : DEADLINE_MS,
    stallMs: STALL_MS,
  };
}

/** How far a landing shows the coarser level; undefined for a scene that has none. */
export function coarseRadiusOf(radiusM: number, { levels }: Pick<SceneManifest, "levels">): number | undefined {
  return levels > 1 ? radiusM * COARSE_REACH : undefined;
}
