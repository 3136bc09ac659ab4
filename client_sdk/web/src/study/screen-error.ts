/**
 * Which segments a usual tiler would draw finely from where the head is: those in view whose coarse stand-in would be wrong by
 * more than some pixels. PURE.
 */

import type { Bounds, Budgets, SegmentFacts, Vec3 } from "../core/types.ts";

/** A segment whose payload came, with the box of its positions. */
export type PlacedSegment = SegmentFacts & { readonly bounds: Bounds };

/** A plane: what has `normal . p + offset >= 0` lies on its inner side. */
export interface Plane {
  readonly normal: Vec3;
  readonly offset: number;
}

/** Where the head is, and what it sees. */
export interface HeadView {
  readonly eye: Vec3;
  /** Of the picture; six of a camera. */
  readonly planes: readonly Plane[];
  /** Pixels that a metre has, seen at a distance of a metre, straight ahead. */
  readonly pixelsPerMetre: number;
}

/** How detail follows the head. */
export interface ScreenErrorOptions {
  /** What the base is off by, metres: the same for every segment of a scene. */
  readonly baseErrorM: number;
  /** Error that the eye may see, pixels. */
  readonly maxErrorPx: number;
  readonly budgets: Budgets;
}

/** Distance at which the base's error has just that many pixels, straight ahead. */
export function refineDistanceM(pixelsPerMetre: number, { baseErrorM, maxErrorPx }: ScreenErrorOptions): number {
  return (baseErrorM * pixelsPerMetre) / maxErrorPx;
}

/** Error that makes a tiler refine as far as a landing of this radius reaches: both conditions then show as much. */
export function matchingErrorPx(pixelsPerMetre: number, baseErrorM: number, radiusM: number): number {
  return (baseErrorM * pixelsPerMetre) / radiusM;
}

/** Whether any of a box is on the inner side of every plane. */
export function isInView(box: Bounds, planes: readonly Plane[]): boolean {
  return planes.every(({ normal: [a, b, c], offset }) => {
    const x = a > 0 ? box[3] : box[0];
    const y = b > 0 ? box[4] : box[1];
    const z = c > 0 ? box[5] : box[2];
    return a * x + b * y + c * z + offset >= 0;
  });
}

/** From a place to the nearest place of a box. */
export function boxDistanceM([x, y, z]: Vec3, box: Bounds): number {
  const dx = Math.max(box[0] - x, 0, x - box[3]);
  const dy = Math.max(box[1] - y, 0, y - box[4]);
  const dz = Math.max(box[2] - z, 0, z - box[5]);
  return Math.hypot(dx, dy, dz);
}

/**
 * The segments to draw, largest error (nearest) first, within the budgets: the first that does not fit ends the list, as in a
 * landing's plan. Ties by id.
 */
export function refinedSegments(
  segments: Iterable<PlacedSegment>,
  view: HeadView,
  options: ScreenErrorOptions,
): readonly number[] {
  const reachM = refineDistanceM(view.pixelsPerMetre, options);
  const candidates: { readonly facts: PlacedSegment; readonly distanceM: number }[] = [];
  for (const facts of segments) {
    const distanceM = boxDistanceM(view.eye, facts.bounds);
    if (distanceM <= reachM && isInView(facts.bounds, view.planes)) candidates.push({ facts, distanceM });
  }
  candidates.sort((a, b) => a.distanceM - b.distanceM || a.facts.segment - b.facts.segment);
  const { maxTriangles = Infinity, maxBytes = Infinity, maxSegments = Infinity } = options.budgets;
  const chosen: number[] = [];
  let [triangles, bytes] = [0, 0];
  for (const { facts } of candidates) {
    triangles += facts.faces;
    bytes += facts.bytes;
    if (triangles > maxTriangles || bytes > maxBytes || chosen.length === maxSegments) break;
    chosen.push(facts.segment);
  }
  return chosen;
}
