/** What of a value is handed over to another thread instead of being copied. */

import type { MeshData, MeshImage, SceneFiles } from "../types.ts";

/** The buffers, and the picture, of a mesh: each once. */
export function transferablesOfMesh(mesh: MeshData): Transferable[] {
  const arrays = [mesh.positions, mesh.normals, mesh.colours, mesh.uvs, mesh.regionIds, mesh.indices];
  for (const attribute of mesh.attributes) arrays.push(attribute.codes);
  return [...buffersOf(arrays), ...(mesh.image === null ? [] : pixelsOf(mesh.image))];
}

/** The buffers of a scene's base mesh. */
export function transferablesOfScene({ base }: SceneFiles): Transferable[] {
  return transferablesOfMesh(base);
}

function buffersOf(arrays: readonly (ArrayBufferView | null)[]): Transferable[] {
  const buffers = new Set<Transferable>();
  for (const array of arrays) {
    if (array !== null && array.buffer instanceof ArrayBuffer) buffers.add(array.buffer);
  }
  return [...buffers];
}

function pixelsOf({ pixels }: MeshImage): Transferable[] {
  return "levels" in pixels ? pixels.levels.map((level) => level.buffer) : [pixels];
}
