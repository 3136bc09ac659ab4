/**
 * What meshes take on a GPU, and what of a device's share of it one landing may take.
 *
 * PURE. The reckoning is that of the protocol, section 4, rule 2: the service makes plans by it.
 */

import type { DeviceBudgets } from "./budgets.ts";
import type { Budgets, MeshData, MeshImage, SceneFiles } from "./types.ts";

/** Bits of a texel of a form that GPUs cannot read: it is decoded to RGBA. */
const UNCOMPRESSED_BITS = 32;
/** Positions 8, normals 4, region ids 4. */
const VERTEX_BYTES = 16;
const COLOUR_BYTES = 8;
const ATTRIBUTE_BYTES = 4;
/** Three indices of 16 bits. */
const FACE_BYTES = 6;
/** Of the device's share: for segments that an aim brought ahead, or that a landing hid. */
const SPARE_SHARE = 1 / 8;
/** Most vertices of a page of segments. Index 65,535 ends a strip in WebGL, so it can name no vertex. */
export const MAX_PAGE_VERTICES = 65_535;
/** Faces of a surface are twice its vertices, nearly. */
const FACES_PER_VERTEX = 2;
/** Two lists of faces, the drawn and the coming one, and a third that the whole base is drawn by. */
const BASE_LISTS = 3;

/** What a stream and a stage are given of a device's share of the GPU. */
export interface GpuShares {
  /** For the stream. */
  readonly budgets: Budgets;
  /** For the stage: bytes of segments that nothing shows or waits for. */
  readonly spareGpuBytes: number;
  /** For the stage: of everything that it puts there. */
  readonly maxGpuBytes: number;
}

/** Bytes of a texture with all its mips; `bits` a texel, 32 or those of blocks of 4 x 4. */
export function textureBytes(width: number, height: number, bits = UNCOMPRESSED_BITS): number {
  let bytes = 0;
  for (let w = width, h = height; ; w = Math.max(w >> 1, 1), h = Math.max(h >> 1, 1)) {
    bytes += bits === UNCOMPRESSED_BITS ? w * h * 4 : Math.ceil(w / 4) * Math.ceil(h / 4) * 2 * bits;
    if (w === 1 && h === 1) return bytes;
  }
}

/** Bytes of an image on the GPU, as it was decoded for this one. */
export function imageBytes({ pixels }: MeshImage): number {
  if ("levels" in pixels) return pixels.levels.reduce((sum, level) => sum + level.byteLength, 0);
  return textureBytes(pixels.width, pixels.height);
}

/** Bytes that a mesh takes on the GPU, texture and indices included. */
export function gpuBytesOf(mesh: MeshData): number {
  const arrays = [mesh.positions, mesh.normals, mesh.colours, mesh.uvs, mesh.regionIds, mesh.indices];
  const codes = mesh.attributes.map((attribute) => attribute.codes);
  const buffers = [...arrays, ...codes].reduce((sum, array) => sum + (array?.byteLength ?? 0), 0);
  return buffers + (mesh.image ? imageBytes(mesh.image) : 0);
}

/** Bytes of a whole page of segments. */
export function pageBytes(vertexBytes: number): number {
  return MAX_PAGE_VERTICES * (vertexBytes + FACES_PER_VERTEX * FACE_BYTES);
}

/**
 * Divide a device's share: the base, an eighth for what nothing shows, room to move a page of segments, and two equal parts for
 * two landings, the one that is drawn and the one that is on its way. So all of it together never exceeds `maxGpuBytes`.
 */
export function sharesOf(device: DeviceBudgets, { manifest, base }: SceneFiles): GpuShares {
  const spareGpuBytes = Math.floor(device.maxGpuBytes * SPARE_SHARE);
  const baseBytes = gpuBytesOf(base) + (BASE_LISTS - 1) * base.indices.byteLength;
  const gpuVertexBytes = VERTEX_BYTES + COLOUR_BYTES + ATTRIBUTE_BYTES * manifest.attributes.length;
  const landingsBytes = device.maxGpuBytes - spareGpuBytes - baseBytes - pageBytes(gpuVertexBytes);
  return {
    spareGpuBytes,
    maxGpuBytes: device.maxGpuBytes,
    budgets: {
      maxTriangles: device.maxTriangles,
      maxSegments: device.maxSegments,
      maxGpuBytes: Math.max(0, Math.floor(landingsBytes / 2)),
      gpuVertexBytes,
      gpuFaceBytes: FACE_BYTES,
    },
  };
}
