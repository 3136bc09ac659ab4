/**
 * The baseline of the study: a stream whose newest landing is declared anew while the head moves, so that the very same viewer
 * shows detail as usual tilers do.
 *
 * A landing itself is the product's: asked for, waited for and shown whole, in both conditions. From then on what is in view
 * and near enough is drawn finely, the rest coarsely; payload comes by aims at where the eye is. PURE but for the stream inside.
 */

import type { GroupCommand } from "../core/group-types.ts";
import type {
  AttributeScale,
  LandOptions,
  MeshData,
  PickHit,
  PlanFacts,
  SegmentSummary,
  Stream,
  StreamEvent,
  StreamStats,
  Vec3,
} from "../core/types.ts";
import { boxDistanceM, type HeadView, refinedSegments, type ScreenErrorOptions } from "./screen-error.ts";

/** Segments that are begun at once: a set is shown when all of it is on the GPU, and the next waits for that. */
const MAX_NEW = 16;
/** The eye has moved so far since payload was asked for last. */
const AIM_STEP_M = 2;
/** What stays on the GPU beside what is drawn, of the radius: as a landing keeps it. */
const KEPT_REACH = 1.25;

/** See the head of the file. */
export class HeadStream implements Stream {
  onEvent: (event: StreamEvent) => void = () => undefined;
  readonly #inner: Stream;
  readonly #facts = new Map<number, SegmentSummary>();
  readonly #held = new Set<number>();
  #plan: PlanFacts | null = null;
  #isReady = false;
  #aimedAt: Vec3 | null = null;
  #declared: readonly number[] | null = null;

  constructor(inner: Stream) {
    this.#inner = inner;
    inner.onEvent = (event) => {
      this.#note(event);
      this.onEvent(event);
    };
  }

  /** Facts of a segment that was ever planned; undefined for another. */
  factsOf(segment: number): SegmentSummary | undefined {
    return this.#facts.get(segment);
  }

  land(position: Vec3, radiusM: number, options?: LandOptions): number {
    this.#plan = null;
    this.#isReady = false;
    this.#declared = null;
    this.#aimedAt = null;
    return this.#inner.land(position, radiusM, options);
  }

  /**
   * The head is there, and these segments are drawn: declare what should be instead. To be called once a frame, and only when
   * what was declared before is drawn. False where nothing changes.
   */
  follow(view: HeadView, visible: readonly number[], options: ScreenErrorOptions): boolean {
    const plan = this.#plan;
    if (plan === null || !this.#isReady) return false;
    this.#fetchAround(view.eye, plan);
    const held = [...this.#held].flatMap((segment) => this.#facts.get(segment) ?? []);
    const wanted = refinedSegments(held, view, options);
    const drawn = new Set(visible);
    const fresh = wanted.filter((segment) => !drawn.has(segment)).slice(0, MAX_NEW);
    const wantedIds = new Set(wanted);
    const next = [...visible.filter((segment) => wantedIds.has(segment)), ...fresh].sort((a, b) => a - b);
    // What cannot be decoded never comes: declared once, it is not declared again and again.
    if (isSame(next, visible) || (this.#declared !== null && isSame(next, this.#declared))) return false;
    this.#declare(plan, next, view.eye, held);
    return true;
  }

  #declare(plan: PlanFacts, segments: readonly number[], eye: Vec3, held: readonly SegmentSummary[]): void {
    const shown = new Set(segments);
    const reachM = plan.radiusM * KEPT_REACH;
    const nearby = held
      .filter(({ segment, bounds }) => !shown.has(segment) && boxDistanceM(eye, bounds) <= reachM)
      .map(({ segment }) => segment);
    this.#declared = segments;
    this.onEvent({ type: "planned", plan: { ...plan, load: [], keep: segments, nearby, loadBytes: 0 } });
    this.onEvent({
      type: "ready",
      landing: plan.landing,
      visible: segments,
      missing: [],
      elapsedMs: 0,
      readyAtMs: 0,
      payloadBytes: 0,
    });
  }

  #fetchAround(eye: Vec3, plan: PlanFacts): void {
    const from = this.#aimedAt ?? plan.position;
    if (Math.hypot(eye[0] - from[0], eye[1] - from[1], eye[2] - from[2]) < AIM_STEP_M) return;
    this.#aimedAt = eye;
    this.#inner.aim(eye, plan.radiusM);
  }

  #note(event: StreamEvent): void {
    switch (event.type) {
      case "planned":
        this.#plan = event.plan;
        for (const facts of event.plan.load) this.#facts.set(facts.segment, facts);
        break;
      case "arrived":
        this.#facts.set(event.facts.segment, event.facts);
        this.#held.add(event.facts.segment);
        break;
      case "ready":
        this.#isReady = true;
        this.#declared = null;
        break;
      case "dropped":
        for (const segment of event.segments) this.#held.delete(segment);
        break;
      case "opened":
        // Ids of another version mean other segments.
        if (event.changed) {
          this.#facts.clear();
          this.#held.clear();
          this.#plan = null;
        }
        break;
      default:
        break;
    }
  }

  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    this.#inner.aim(position, radiusM, coarseRadiusM);
  }

  pick(origin: Vec3, direction?: Vec3): Promise<PickHit | null> {
    return this.#inner.pick(origin, direction);
  }

  mesh(segment: number, attributes: readonly AttributeScale[]): Promise<MeshData> {
    return this.#inner.mesh(segment, attributes);
  }

  stats(): Promise<StreamStats> {
    return this.#inner.stats();
  }

  group(command: GroupCommand): void {
    this.#inner.group(command);
  }

  reconnect(token?: string): void {
    this.#inner.reconnect(token);
  }

  close(): void {
    this.#inner.close();
  }
}

function isSame(a: readonly number[], b: readonly number[]): boolean {
  return a.length === b.length && a.every((id, index) => id === b[index]);
}
