/**
 * The log of a session: head, landings, changes of what is visible, frames, forms (spec/study-log.md). PURE: time is an argument.
 */

import type { Vec3 } from "../core/types.ts";
import { type HeadView, isInView, type PlacedSegment } from "./screen-error.ts";

/** Frames of an hour at 90 a second; a session that goes on is cut there, and the log says so. */
export const MAX_FRAMES = 324_000;
const MAX_CHANGES = 100_000;

export type Condition = "landings" | "head";

/** What a session is of. */
export interface SessionFacts {
  readonly condition: Condition;
  readonly scene: string;
  readonly sceneVersion: string;
  readonly viewer: string;
  readonly participant: string;
  readonly order: number;
  readonly radiusM: number;
  /** Of the baseline; null where detail does not follow the head. */
  readonly maxErrorPx: number | null;
  readonly walk: "live" | "recorded";
  /** A date, ISO 8601. */
  readonly started: string;
  readonly device: string;
}

/** The head in one frame. */
export interface Head {
  readonly position: Vec3;
  readonly yawDeg: number;
  readonly pitchDeg: number;
  readonly rollDeg: number;
}

interface Change {
  readonly tMs: number;
  readonly landing: number;
  readonly byLanding: boolean;
  readonly shown: readonly number[];
  readonly hidden: readonly number[];
  readonly shownInView: number;
  readonly hiddenInView: number;
}

interface Landing {
  readonly landing: number;
  readonly askedMs: number;
  arrivedMs: number | null;
  readonly position: Vec3;
  readonly radiusM: number;
}

/** A filled-in form. */
export interface FormAnswers {
  readonly name: "SSQ" | "VRSQ";
  readonly when: "before" | "after";
  readonly tMs: number;
  /** 0 to 3, in the form's order. */
  readonly answers: readonly number[];
}

/** Where the newest landing stands, for {@link SessionLog.frame}. */
export interface LandingNow {
  readonly landing: number;
  readonly isShown: boolean;
  readonly position: Vec3;
  readonly radiusM: number;
}

/** Gathers a session. */
export class SessionLog {
  readonly #facts: SessionFacts;
  readonly #frames = {
    t_ms: [] as number[],
    x_m: [] as number[],
    y_m: [] as number[],
    z_m: [] as number[],
    yaw_deg: [] as number[],
    pitch_deg: [] as number[],
    roll_deg: [] as number[],
    frame_ms: [] as number[],
  };
  readonly #changes: Change[] = [];
  readonly #landings: Landing[] = [];
  readonly #forms: FormAnswers[] = [];
  #visible = new Set<number>();
  #isCut = false;

  constructor(facts: SessionFacts) {
    this.#facts = facts;
  }

  get frames(): number {
    return this.#frames.t_ms.length;
  }

  /** Changes of what is drawn between landings, segments in view alone. */
  get changesInView(): number {
    return this.#changes.reduce(
      (sum, change) => sum + (change.byLanding ? 0 : change.shownInView + change.hiddenInView),
      0,
    );
  }

  form(answers: FormAnswers): void {
    this.#forms.push(answers);
  }

  /** Once a frame, with what is drawn in it. `frameMs` is wall time since the frame before. */
  frame(
    tMs: number,
    frameMs: number,
    head: Head,
    view: HeadView,
    visible: readonly number[],
    now: LandingNow,
    factsOf: (segment: number) => PlacedSegment | undefined,
  ): void {
    const isUnderWay = this.#noteLanding(tMs, now);
    this.#noteChange(tMs, now.landing, isUnderWay, view, visible, factsOf);
    if (this.frames >= MAX_FRAMES) {
      this.#isCut = true;
      return;
    }
    const row = [tMs, ...head.position, head.yawDeg, head.pitchDeg, head.rollDeg, frameMs];
    for (const [index, column] of Object.values(this.#frames).entries()) column.push(rounded(row[index]!));
  }

  /** Whether what changes in this frame is the landing's own doing. */
  #noteLanding(tMs: number, { landing, isShown, position, radiusM }: LandingNow): boolean {
    if (landing <= 0) return true;
    let newest = this.#landings.at(-1);
    if (newest?.landing !== landing) {
      newest = { landing, askedMs: tMs, arrivedMs: null, position, radiusM };
      this.#landings.push(newest);
    }
    if (newest.arrivedMs !== null) return false;
    if (isShown) newest.arrivedMs = tMs;
    return true;
  }

  #noteChange(
    tMs: number,
    landing: number,
    byLanding: boolean,
    view: HeadView,
    visible: readonly number[],
    factsOf: (segment: number) => PlacedSegment | undefined,
  ): void {
    const after = new Set(visible);
    const shown = visible.filter((segment) => !this.#visible.has(segment));
    const hidden = [...this.#visible].filter((segment) => !after.has(segment));
    this.#visible = after;
    if (shown.length + hidden.length === 0) return;
    if (this.#changes.length >= MAX_CHANGES) {
      this.#isCut = true;
      return;
    }
    const inView = (segments: readonly number[]): number =>
      segments.filter((segment) => {
        const facts = factsOf(segment);
        // One that nothing is known of counts: nothing may be left out in favour of either condition.
        return facts === undefined || isInView(facts.bounds, view.planes);
      }).length;
    const [shownInView, hiddenInView] = [inView(shown), inView(hidden)];
    this.#changes.push({ tMs, landing, byLanding, shown, hidden, shownInView, hiddenInView });
  }

  /** The log as it is written (spec/study-log.md). */
  toJson(): object {
    const facts = this.#facts;
    return {
      form: 1,
      condition: facts.condition,
      scene: facts.scene,
      scene_version: facts.sceneVersion,
      viewer: facts.viewer,
      participant: facts.participant,
      order: facts.order,
      radius_m: facts.radiusM,
      max_error_px: facts.maxErrorPx,
      walk: facts.walk,
      started: facts.started,
      device: facts.device,
      cut: this.#isCut,
      frames: this.#frames,
      landings: this.#landings.map(({ landing, askedMs, arrivedMs, position, radiusM }) => ({
        landing,
        asked_ms: rounded(askedMs),
        arrived_ms: arrivedMs === null ? null : rounded(arrivedMs),
        position,
        radius_m: radiusM,
      })),
      changes: this.#changes.map((change) => ({
        t_ms: rounded(change.tMs),
        landing: change.landing,
        by_landing: change.byLanding,
        shown: change.shown,
        hidden: change.hidden,
        shown_in_view: change.shownInView,
        hidden_in_view: change.hiddenInView,
      })),
      forms: this.#forms.map(({ name, when, tMs, answers }) => ({ name, when, t_ms: rounded(tMs), answers })),
    };
  }
}

function rounded(value: number): number {
  return Math.round(value * 1000) / 1000;
}
