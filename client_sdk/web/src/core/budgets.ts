/**
 * What a device is asked to hold: the bounds of a landing, of the caches beside it, and of the GPU.
 *
 * PURE. The table with reasons stands in this package's README, section "Bounds".
 */

import type { Budgets } from "./types.ts";

/** What a page can tell apart without asking for more rights. */
export type DeviceClass = "desktop" | "phone" | "headset";

/** Bounds of everything that can grow with the length of a visit. */
export interface DeviceBudgets extends Budgets {
  readonly maxTriangles: number;
  readonly maxBytes: number;
  readonly maxSegments: number;
  /** Radius of a landing unless the user chooses another, metres. */
  readonly radiusM: number;
  /** Payload bytes kept in the worker beside what is shown. */
  readonly cacheBytes: number;
  /** Payload bytes kept on disk for the next visit, of all scenes. */
  readonly diskBytes: number;
  /** Payload bytes under way at most. */
  readonly creditBytes: number;
  /** Buffers and textures on the GPU of segments that nothing shows or waits for. */
  readonly spareGpuBytes: number;
}

const MIB = 1024 * 1024;

const BUDGETS: Readonly<Record<DeviceClass, DeviceBudgets>> = {
  // 60 m of a survey with 80 triangles per square metre is 1.2 million triangles and 8 MiB: five times that is left for
  // denser surveys and textures.
  desktop: {
    maxTriangles: 6_000_000,
    maxBytes: 96 * MIB,
    maxSegments: 4096,
    radiusM: 60,
    cacheBytes: 256 * MIB,
    diskBytes: 256 * MIB,
    creditBytes: 16 * MIB,
    spareGpuBytes: 256 * MIB,
  },
  // A page that takes more than a few hundred MiB is closed by the phone's system, GPU memory included.
  phone: {
    maxTriangles: 1_500_000,
    maxBytes: 32 * MIB,
    maxSegments: 1024,
    radiusM: 40,
    cacheBytes: 48 * MIB,
    diskBytes: 64 * MIB,
    creditBytes: 4 * MIB,
    spareGpuBytes: 64 * MIB,
  },
  // Two eyes, 72 times a second, on a phone's GPU: triangles are what is scarce, and draw calls, of which each segment
  // in view is one for each eye; memory less so.
  headset: {
    maxTriangles: 900_000,
    maxBytes: 32 * MIB,
    maxSegments: 512,
    radiusM: 40,
    cacheBytes: 96 * MIB,
    diskBytes: 128 * MIB,
    creditBytes: 8 * MIB,
    spareGpuBytes: 96 * MIB,
  },
};

/** The bounds of a class of devices. */
export function budgetsFor(device: DeviceClass): DeviceBudgets {
  return BUDGETS[device];
}
