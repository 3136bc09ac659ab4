/** What a landing adds to the base, in numbers. PURE. */

import type { MeshData } from "../core/types.ts";
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
 * The gain of what is shown; null where no face of the base is hidden under full detail.
 *
 * @param hidden - bit set of the base faces that are not drawn. Only those whose middle lies under full detail count: beyond it
 *   the coarser level is shown.
 * @param full - segments at full detail. Those at the rim extend beyond the hidden faces by part of a segment: the gain of a
 *   small landing comes out a little too high.
 */
export function gainOf(
  base: MeshData,
  hidden: Uint8Array,
  full: readonly Pick<MeshData, "bounds" | "faceCount">[],
): Gain | null {
  const { positions, indices, stepM, translation } = base;
  const stride = positions instanceof Uint16Array ? 4 : 3;
  const corner = (at: number, axis: number) => positions[indices[at]! * stride + axis]! * stepM + translation[axis]!;
  const isUnder = (x: number, z: number) =>
    full.some(({ bounds: b }) => x >= b[0] && x <= b[3] && z >= b[2] && z <= b[5]);
  let baseFaces = 0;
  let doubled = 0;
  for (let face = 0; face < base.faceCount; face += 1) {
    if (!hasFace(hidden, face)) continue;
    const at = 3 * face;
    const [a, b, c] = [0, 1, 2].map((one) => [0, 1, 2].map((axis) => corner(at + one, axis))) as [Xyz, Xyz, Xyz];
    if (!isUnder((a[0] + b[0] + c[0]) / 3, (a[2] + b[2] + c[2]) / 3)) continue;
    const [ux, uy, uz] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    const [vx, vy, vz] = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    doubled += Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
    baseFaces += 1;
  }
  if (baseFaces === 0) return null;
  const detailFaces = full.reduce((sum, { faceCount }) => sum + faceCount, 0);
  return { detailFaces, baseFaces, areaM2: doubled / 2 };
}

type Xyz = [number, number, number];
