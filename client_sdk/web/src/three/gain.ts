/** What a landing adds to the base, in numbers. PURE. */

import type { MeshData, Vec3 } from "../core/types.ts";
import { hasFace } from "./face-set.ts";

/** Full detail and the base that it replaces. */
export interface Gain {
  readonly detailFaces: number;
  /** Faces of the base that are hidden under it. */
  readonly baseFaces: number;
  /** Of those faces, square metres. */
  readonly areaM2: number;
}

/** Metres from one point of a surface to the next: a surface of triangles has about half as many points as faces. */
export function pointSpacingM(areaM2: number, faces: number): number {
  return Math.sqrt((2 * areaM2) / faces);
}

/**
 * The gain of what is shown; null where no face of the base is hidden within the radius.
 *
 * @param hidden - bit set of the base faces that are not drawn. Only those within `radiusM` of `centre` count: beyond it
 *   the coarser level is shown.
 * @param detailFaces - faces of the segments at full detail. Those at the rim extend beyond the hidden faces by part of a
 *   segment: the gain of a small landing comes out a little too high.
 */
export function gainOf(
  base: MeshData,
  hidden: Uint8Array,
  centre: Vec3,
  radiusM: number,
  detailFaces: number,
): Gain | null {
  const { positions, indices, stepM, translation } = base;
  const stride = positions instanceof Uint16Array ? 4 : 3;
  const corner = (at: number, axis: number) => positions[indices[at]! * stride + axis]! * stepM + translation[axis]!;
  let baseFaces = 0;
  let doubled = 0;
  for (let face = 0; face < base.faceCount; face += 1) {
    if (!hasFace(hidden, face)) continue;
    const at = 3 * face;
    const [x, y, z] = [0, 1, 2].map((axis) => corner(at, axis)) as [number, number, number];
    if (Math.hypot(x - centre[0], y - centre[1], z - centre[2]) > radiusM) continue;
    const [ux, uy, uz] = [corner(at + 1, 0) - x, corner(at + 1, 1) - y, corner(at + 1, 2) - z];
    const [vx, vy, vz] = [corner(at + 2, 0) - x, corner(at + 2, 1) - y, corner(at + 2, 2) - z];
    doubled += Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
    baseFaces += 1;
  }
  return baseFaces === 0 ? null : { detailFaces, baseFaces, areaM2: doubled / 2 };
}
