/**
 * The faces of the base mesh that a set of segments hides.
 *
 * The rule (docs/topics/hand-off.md): a base face is hidden if and only if its list in the cover is not empty and every
 * segment in it is shown. No distance, no geometry: the outcome depends on the set alone.
 *
 * PURE.
 */

import type { Cover } from "./types.ts";

/** Return a bit set of the hidden faces: bit `face & 7` of byte `face >> 3`. */
export function hiddenFaces({ offsets, segments }: Cover, shown: ReadonlySet<number>): Uint8Array {
  const faceCount = offsets.length - 1;
  const hidden = new Uint8Array(Math.ceil(faceCount / 8));
  for (let face = 0; face < faceCount; face += 1) {
    const end = offsets[face + 1]!;
    let at = offsets[face]!;
    if (at === end) continue;
    while (at < end && shown.has(segments[at]!)) at += 1;
    if (at === end) hidden[face >> 3]! |= 1 << (face & 7);
  }
  return hidden;
}
