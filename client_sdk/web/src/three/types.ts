/** The values that pass between the drawn scene (`three`), the headset (`xr`) and the page (`app`). */

import type { Bounds, LandOptions, PlanFacts, SegmentKey, StreamStats, Vec3 } from "../core/types.ts";

/** How the ground is coloured. `colour` is the survey's own look: textures where there are any, else vertex colours. */
export type ViewMode =
  | { readonly kind: "colour" }
  | { readonly kind: "vertex-colour" }
  | { readonly kind: "regions" }
  | { readonly kind: "names" }
  | { readonly kind: "segments" }
  | { readonly kind: "attribute"; readonly name: string; readonly min: number; readonly max: number }
  | { readonly kind: "slope" };

/** A point of what is shown. */
export interface GroundHit {
  readonly position: Vec3;
  /** Unit, towards the ray's origin. */
  readonly normal: Vec3;
  /** Whether the ray met the outer side of the ground; false where it came from inside the rock. */
  readonly isOuter: boolean;
  readonly distanceM: number;
  /** Segment id, or -1 for the base. */
  readonly segment: number;
  /** Region of the face, where the mesh says it; else -1. */
  readonly region: number;
}

/**
 * Where the newest landing stands.
 *
 * `planning`: no plan yet. `streaming`: payload is on its way or being uploaded. `presentable`: everything is on the GPU
 * and `swap` will show it. `degraded-presentable`: the same for the inner set, past the deadline. `shown`: swapped.
 * `idle`: there was no landing. `refused`: the server said no; what is shown stays.
 */
export type LandingPhase =
  | "idle"
  | "planning"
  | "streaming"
  | "degraded-presentable"
  | "presentable"
  | "shown"
  | "refused";

/** How far the newest landing is, and what is known of it. */
export interface LandingStatus {
  readonly landing: number;
  readonly phase: LandingPhase;
  readonly position: Vec3;
  readonly radiusM: number;
  /** 0 to 1: bytes that came and were uploaded, of those that must. */
  readonly fraction: number;
  readonly plan: PlanFacts | null;
  /**
   * Milliseconds land -> ready (all bytes verified) and land -> presentable; null until then. A place that was shown before may
   * be shown again before the service's `ready`: `phase` is `shown` then, and `readyMs` null until it is there.
   */
  readonly readyMs: number | null;
  readonly presentableMs: number | null;
  readonly payloadBytes: number;
  readonly missing: readonly SegmentKey[];
  /** Why it was refused. */
  readonly refusal: string | null;
}

/**
 * Where a model of the scene stands, and how small: the scene's point `middle` is at `at`, both in the scene's frame, metres.
 * It is never turned: what lies north in the scene lies north of the model's middle.
 */
export interface MiniaturePose {
  readonly middle: Vec3;
  readonly at: Vec3;
  /** Metres of the model for a metre of the ground. */
  readonly scale: number;
}

/** What one swap changed. */
export interface SwapReport {
  readonly landing: number;
  readonly shown: readonly SegmentKey[];
  readonly hidden: readonly SegmentKey[];
  readonly hiddenBaseFaces: number;
  readonly degraded: boolean;
}

/** What the drawn scene holds on the GPU, counted by us. */
export interface GpuMemory {
  readonly segments: number;
  readonly visibleSegments: number;
  /** Common buffers that segments lie in: draw calls for an eye that sees all of them. */
  readonly pages: number;
  readonly bufferBytes: number;
  readonly textureBytes: number;
  /** Bytes created and freed since the start; their difference is what is held. */
  readonly createdBytes: number;
  readonly freedBytes: number;
}

/** What a terrain holds and has done: for a panel of figures, or a log. */
export interface TerrainStats {
  readonly stream: StreamStats | null;
  readonly gpu: GpuMemory;
  /** Main memory held for picking: positions, indices and region ids of what is on the GPU. */
  readonly pickingBytes: number;
  readonly visibleTriangles: number;
  /** Longest and median milliseconds that `update` took, over the last 240 frames. */
  readonly updateMaxMs: number;
  readonly updateMedianMs: number;
}

/**
 * What is visible, as a value: equal strings mean the same segments and the same hidden base faces. Changes only in
 * `Terrain.swap` (and when a new scene version is opened).
 */
export type VisibleDigest = string;

/** The part of a terrain that the headset and the page use to land. */
export interface Landings {
  /** Of the newest landing: that of `land` as soon as it was called. */
  readonly status: LandingStatus;
  /** Numbers of the segments shown; those at the coarser level are counted on from the finer ones. */
  readonly shownSegments: readonly number[];
  land(position: Vec3, radiusM: number, options?: LandOptions): Promise<LandingStatus>;
  prefetch(position: Vec3, radiusM: number): void;
  /** Show the presentable set: visibility flags only, within one frame. Null where nothing is presentable. */
  swap(): SwapReport | null;
  /** First point of what is shown along a ray. `direction` need not be a unit vector. */
  cast(origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null;
  /**
   * Ground at (x, z) of what is shown: the highest not above `fromY`, else the lowest above it. What faces down is a ceiling,
   * no ground, wherever there is any other.
   */
  groundAt(x: number, z: number, fromY: number): GroundHit | null;
  readonly bounds: Bounds;
}
