/** What a landing has made sharper, in numbers. PURE. */

import type { Cover, MeshData } from "../core/types.ts";

/** Full detail and the base that it stands for. */
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
 * Faces of the base that are hidden under full detail alone: one byte each. What is hidden under the coarser level gained
 * less, and would be told as if it lay at one's feet.
 *
 * @param isFull - whether a segment is shown at full detail.
 */
export function underFullDetail(hidden: Uint8Array, cover: Cover, isFull: (segment: number) => boolean): Uint8Array {
  const { offsets, segments } = cover;
  return hidden.map((isHidden, face) =>
    isHidden === 1 && segments.subarray(offsets[face]!, offsets[face + 1]!).every(isFull) ? 1 : 0,
  );
}

/**
 * The gain of what is shown; null where nothing of the base is hidden.
 *
 * @param hidden - one byte per face of the base, 1 where it is hidden.
 * @param detailFaces - faces of the segments that are shown. Those at the rim reach beyond the hidden faces by part of a
 *   segment: the gain of a small landing is told a little too high.
 */
export function gainOf(base: MeshData, hidden: Uint8Array, detailFaces: number): Gain | null {
  const { positions, indices, stepM } = base;
  const stride = positions instanceof Uint16Array ? 4 : 3;
  const corner = (at: number, axis: number) => positions[indices[at]! * stride + axis]!;
  let baseFaces = 0;
  let doubled = 0;
  for (let face = 0; face < hidden.length; face += 1) {
    if (hidden[face] !== 1) continue;
    const at = 3 * face;
    const [ux, uy, uz] = [0, 1, 2].map((axis) => corner(at + 1, axis) - corner(at, axis)) as [number, number, number];
    const [vx, vy, vz] = [0, 1, 2].map((axis) => corner(at + 2, axis) - corner(at, axis)) as [number, number, number];
    doubled += Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
    baseFaces += 1;
  }
  return baseFaces === 0 ? null : { detailFaces, baseFaces, areaM2: (doubled / 2) * stepM * stepM };
}
