/**
 * What a device is asked to hold: the bounds of a landing, of the caches beside it, and of the GPU.
 *
 * PURE. The table with reasons stands in this package's README, section "Bounds".
 */

/** What a page can tell apart without asking for more rights. */
export type DeviceClass = "desktop" | "phone" | "headset";

/** Bounds of everything that can grow with the length of a visit. */
export interface DeviceBudgets {
  readonly maxTriangles: number;
  readonly maxSegments: number;
  /**
   * Everything on the GPU: base, what is shown, what is coming, what an aim brought; textures with their mips.
   * `sharesOf` divides it.
   */
  readonly maxGpuBytes: number;
  /** Radius of a landing unless the user chooses another, metres. */
  readonly radiusM: number;
  /** Payload bytes kept in the worker beside what is shown. */
  readonly cacheBytes: number;
  /** Payload bytes kept on disk for the next visit, of all scenes. */
  readonly diskBytes: number;
  /** Payload bytes under way at most. */
  readonly creditBytes: number;
}

const MIB = 1024 * 1024;

const BUDGETS: Readonly<Record<DeviceClass, DeviceBudgets>> = {
  // 60 m of a survey with 80 triangles per square metre is 1.2 million triangles and 8 MiB: five times that is left for
  // denser surveys and textures.
  desktop: {
    maxTriangles: 6_000_000,
    maxSegments: 4096,
    radiusM: 60,
    cacheBytes: 256 * MIB,
    diskBytes: 256 * MIB,
    creditBytes: 16 * MIB,
    maxGpuBytes: 1024 * MIB,
  },
  // A page that takes more than a few hundred MiB is closed by the phone's system, GPU memory included.
  phone: {
    maxTriangles: 1_500_000,
    maxSegments: 1024,
    radiusM: 40,
    cacheBytes: 48 * MIB,
    diskBytes: 64 * MIB,
    creditBytes: 4 * MIB,
    maxGpuBytes: 256 * MIB,
  },
  // Two eyes, 72 times a second, on a phone's GPU: triangles are what is scarce, and draw calls, of which each segment
  // in view is one for each eye; memory less so.
  headset: {
    maxTriangles: 900_000,
    maxSegments: 512,
    radiusM: 40,
    cacheBytes: 96 * MIB,
    diskBytes: 128 * MIB,
    creditBytes: 8 * MIB,
    maxGpuBytes: 512 * MIB,
  },
};

/** Of a device's memory, for a page's buffers and textures: where the GPU has none of its own, both come out of one. */
const GPU_SHARE = 1 / 8;

/**
 * The bounds of a class of devices.
 *
 * @param memoryGib Main memory where it is known (`navigator.deviceMemory`): less than is usual for the class takes less.
 */
export function budgetsFor(device: DeviceClass, memoryGib?: number): DeviceBudgets {
  const budgets = BUDGETS[device];
  if (memoryGib === undefined) return budgets;
  return { ...budgets, maxGpuBytes: Math.min(budgets.maxGpuBytes, memoryGib * 1024 * MIB * GPU_SHARE) };
}
