/** How a stage's ground looks, whatever of it is visible: its mode, the wash over what became sharp, base beside detail. */

import type { WebGLRenderer } from "three";

import type { SegmentKey } from "../core/types.ts";
import type { BaseGround } from "./base-ground.ts";
import type { GroundMaterial } from "./ground-material.ts";
import type { GroundSet } from "./ground-set.ts";
import type { Shading } from "./ground-shading.ts";
import type { MiniaturePose, ViewMode } from "./types.ts";

/** Light or dark page: decides the grey of "no value" alone. */
export type Theme = "light" | "dark";

/** What became sharp is washed with colour so strongly, and for so long. */
const FRESH_SHARE = 0.6;
const FRESH_MS = 1600;

/** See the head of the file. */
export class StageLooks {
  readonly #material: GroundMaterial;
  readonly #grounds: GroundSet;
  #mode: ViewMode = { kind: "colour" };
  #newlyShown: ReadonlySet<SegmentKey> = new Set();
  #freshSinceMs: number | null = null;
  /** Where base and detail are compared, as a share of the picture's width; null where they are not. */
  split: number | null = null;
  /** Where a model of the scene stands; null where there is none. */
  miniature: MiniaturePose | null = null;

  constructor(material: GroundMaterial, grounds: GroundSet) {
    this.#material = material;
    this.#grounds = grounds;
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
    this.#grounds.setMeasure(this.measureName);
    base.setMeasure(this.measureName);
  }

  setShading(shading: Shading, base: BaseGround): void {
    this.#material.setShading(shading);
    this.#grounds.dress();
    base.dress();
  }

  /** These were shown by the newest swap. */
  swapped(shown: readonly SegmentKey[]): void {
    this.#newlyShown = new Set(shown);
  }

  /** Wash what the newest swap has shown. */
  markFresh(nowMs: number): void {
    this.#grounds.markFresh(this.#newlyShown);
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
      this.#grounds.markFresh(new Set());
    }
  }
}
