/** What a stage is made of, and what its residency is told. */

import type { WebGLRenderer } from "three";

import { Residency } from "../core/residency.ts";
import type { SceneFiles, Stream } from "../core/types.ts";
import type { Shading } from "./ground-shading.ts";

/** What a stage is made of. */
export interface StageOptions {
  readonly renderer: WebGLRenderer;
  readonly stream: Stream;
  readonly files: SceneFiles;
  /** Bytes on the GPU of segments that nothing shows or waits for (prefetched by an aim). Default 128 MiB. */
  readonly spareGpuBytes?: number;
  /**
   * Most bytes on the GPU of everything that the stage puts there, as `sharesOf` divides them: where pages of segments would take
   * more, they are moved together. Default: no bound; then pages take at most twice what lives in them.
   */
  readonly maxGpuBytes?: number;
  /**
   * Milliseconds of one frame for uploads. Default 1.5 in a headset; else 3, or, where frames are slow anyway, a seventh of
   * their interval up to 30 ms, so that a landing does not take ten times as long there.
   */
  readonly uploadBudgetMs?: number;
  /** What the ground takes part in of the scene around it, from the start; see `Stage.setShading`. */
  readonly shading?: Shading;
}

const DEFAULT_GPU_BYTES = 128 * 1024 * 1024;
/** Segments decoded ahead of their upload. Small ones need many, since each takes two frames; textures take up to 22 MB each. */
const MAX_IN_FLIGHT = 16;
const MAX_IN_FLIGHT_BYTES = 64 * 1024 * 1024;

/** The residency of a stage with these options. */
export function residencyOf(options: StageOptions): Residency {
  return new Residency({
    maxInFlight: MAX_IN_FLIGHT,
    maxInFlightBytes: MAX_IN_FLIGHT_BYTES,
    spareBytes: options.spareGpuBytes ?? DEFAULT_GPU_BYTES,
  });
}
