/** Sets of faces as bits: face `f` is bit `f & 7` of byte `f >> 3`. PURE. */

/** Whether a face is in the set. */
export function hasFace(faces: Uint8Array, face: number): boolean {
  return ((faces[face >> 3]! >> (face & 7)) & 1) === 1;
}

/** Number of faces in the set. */
export function countFaces(faces: Uint8Array): number {
  let count = 0;
  for (let bits of faces) for (; bits !== 0; bits &= bits - 1) count += 1;
  return count;
}

/** 32-bit hash of the set (FNV-1a over the bytes that are not 0 and their places); 0 for the empty set. */
export function hashFaces(faces: Uint8Array): number {
  let hash = 0;
  faces.forEach((bits, at) => {
    if (bits !== 0) hash = Math.imul(Math.imul(hash ^ at, 0x01000193) ^ bits, 0x01000193);
  });
  return hash >>> 0;
}
