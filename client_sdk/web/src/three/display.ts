/** How the ground of a terrain is displayed: mode, shading, the tint of new segments, base next to detail, the model. */

import type { WebGLRenderer } from "three";

import type { SegmentKey } from "../core/types.ts";
import type { BaseGround } from "./base-ground.ts";
import type { GroundMaterial } from "./ground-material.ts";
import type { Shading } from "./ground-shading.ts";
import type { SegmentSet } from "./segment-set.ts";
import type { MiniaturePose, ViewMode } from "./types.ts";

/** Light or dark page: decides the grey of "no value" alone. */
export type Theme = "light" | "dark";

/** Strength and duration of the tint of new segments. */
const FRESH_SHARE = 0.6;
const FRESH_MS = 1600;

/** See the head of the file. */
export class Display {
  readonly #material: GroundMaterial;
  readonly #segments: SegmentSet;
  #mode: ViewMode = { kind: "colour" };
  #newlyShown: ReadonlySet<SegmentKey> = new Set();
  #freshSinceMs: number | null = null;
  /** Where base and detail are compared, as a share of the picture's width; null where they are not. */
  split: number | null = null;
  /** Where a model of the scene stands; null where there is none. */
  miniature: MiniaturePose | null = null;

  constructor(material: GroundMaterial, segments: SegmentSet) {
    this.#material = material;
    this.#segments = segments;
  }

  get mode(): ViewMode {
    return this.#mode;
  }

  /** Whether something is washed. */
  get isFading(): boolean {
    return this.#freshSinceMs !== null;
  }

  /** Of the attribute in view; null without one. */
  get measureName(): string | null {
    return this.#mode.kind === "attribute" ? this.#mode.name : null;
  }

  setMode(mode: ViewMode, theme: Theme, base: BaseGround): void {
    this.#mode = mode;
    this.#material.setMode(mode, theme);
    this.#segments.setMeasure(this.measureName);
    base.setMeasure(this.measureName);
  }

  setShading(shading: Shading, base: BaseGround): void {
    this.#material.setShading(shading);
    this.#segments.dress();
    base.dress();
  }

  /** These were shown by the newest swap. */
  swapped(shown: readonly SegmentKey[]): void {
    this.#newlyShown = new Set(shown);
  }

  /** Wash what the newest swap has shown. */
  markFresh(nowMs: number): void {
    this.#segments.markFresh(this.#newlyShown);
    this.#freshSinceMs = nowMs;
  }

  /** Once per frame. In a headset nothing is compared: its eyes have no common picture to divide. */
  update(nowMs: number, base: BaseGround, renderer: WebGLRenderer): void {
    this.#fade(nowMs);
    const share = renderer.xr.isPresenting ? null : this.split;
    const isCompared = base.setCompared(share !== null) && share !== null;
    this.#material.setSplit(isCompared ? share * renderer.domElement.width : null);
    base.setMiniature(this.miniature);
  }

  #fade(nowMs: number): void {
    if (this.#freshSinceMs === null) return;
    const left = 1 - (nowMs - this.#freshSinceMs) / FRESH_MS;
    this.#material.setFresh(Math.max(0, left) * FRESH_SHARE);
    if (left <= 0) {
      this.#freshSinceMs = null;
      this.#segments.markFresh(new Set());
    }
  }
}
