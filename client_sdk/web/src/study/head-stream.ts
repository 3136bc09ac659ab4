/**
 * The baseline of the study: a stream whose newest landing is declared anew while the head moves, so that the very same viewer
 * shows detail as usual tilers do.
 *
 * A landing itself is the product's: asked for, waited for and shown whole, in both conditions. From then on what is in view
 * and near enough is drawn finely, the rest coarsely; payload comes by landings of its own where the eye is, of which the stage
 * is not told. PURE but for the stream inside.
 */

import type { GroupCommand } from "../core/extras/group-types.ts";
import type {
  AttributeScale,
  FaceBits,
  LandOptions,
  MeshData,
  PickHit,
  PlanFacts,
  SegmentKey,
  Stream,
  StreamEvent,
  StreamStats,
  Vec3,
} from "../core/types.ts";
import { type HeadView, type PlacedSegment, refinedSegments, type ScreenErrorOptions } from "./screen-error.ts";

/** Segments that are begun at once: a set is shown when all of it is on the GPU, and the next waits for that. */
const MAX_NEW = 16;
/** The eye has moved so far since payload was asked for last. */
const FETCH_STEP_M = 2;

/** See the head of the file. */
export class HeadStream implements Stream {
  onEvent: (event: StreamEvent) => void = () => undefined;
  readonly #inner: Stream;
  /** By number in the scene. */
  readonly #placed = new Map<number, PlacedSegment>();
  #landing = 0;
  /** The landing's own plan, and the newest of those where the eye is. */
  #plan: PlanFacts | null = null;
  #newest: PlanFacts | null = null;
  readonly #bounds = new Map<SegmentKey, PlacedSegment["bounds"]>();
  #isReady = false;
  #fetchedAt: Vec3 | null = null;
  #declared: readonly number[] | null = null;

  constructor(inner: Stream) {
    this.#inner = inner;
    inner.onEvent = (event) => {
      if (this.#note(event)) this.onEvent(event);
    };
  }

  /** A segment that a plan named and that came; undefined for another. */
  factsOf(segment: number): PlacedSegment | undefined {
    return this.#placed.get(segment);
  }

  land(position: Vec3, radiusM: number, options?: LandOptions): number {
    this.#plan = null;
    this.#isReady = false;
    this.#declared = null;
    this.#fetchedAt = null;
    this.#landing = this.#inner.land(position, radiusM, options);
    return this.#landing;
  }

  /**
   * The head is there, and these segments are drawn: declare what should be instead. To be called once a frame, and only when
   * what was declared before is drawn. False where nothing changes.
   */
  follow(view: HeadView, visible: readonly number[], options: ScreenErrorOptions): boolean {
    const plan = this.#plan;
    if (plan === null || !this.#isReady) return false;
    this.#fetchAround(view.eye, plan);
    const wanted = refinedSegments(this.#placed.values(), view, options);
    const drawn = new Set(visible);
    const fresh = wanted.filter((segment) => !drawn.has(segment)).slice(0, MAX_NEW);
    const wantedIds = new Set(wanted);
    const next = [...visible.filter((segment) => wantedIds.has(segment)), ...fresh].sort((a, b) => a - b);
    // What cannot be decoded never comes: declared once, it is not declared again and again.
    if (isSame(next, visible) || (this.#declared !== null && isSame(next, this.#declared))) return false;
    this.#declare(plan, next);
    return true;
  }

  #declare(plan: PlanFacts, segments: readonly number[]): void {
    this.#declared = segments;
    const show = segments.flatMap((segment) => this.#placed.get(segment) ?? []);
    const visible = show.map(({ key }) => key);
    const hidden = this.#hiddenUnder(new Set(visible));
    this.onEvent({ type: "planned", plan: { ...plan, show, hidden, loadBytes: 0 } });
    const { landing } = plan;
    const facts = { landing, visible, hidden, missing: [], elapsedMs: 0, readyAtMs: 0, payloadBytes: 0 };
    this.onEvent({ type: "ready", ...facts });
  }

  /** Base faces under these: those of the newest plan where all that it shows is among them, else none. */
  #hiddenUnder(visible: ReadonlySet<SegmentKey>): FaceBits {
    const plan = this.#newest ?? this.#plan;
    if (plan === null) return new Uint8Array();
    return plan.show.every(({ key }) => visible.has(key)) ? plan.hidden : new Uint8Array(plan.hidden.length);
  }

  #fetchAround(eye: Vec3, plan: PlanFacts): void {
    const from = this.#fetchedAt ?? plan.position;
    if (Math.hypot(eye[0] - from[0], eye[1] - from[1], eye[2] - from[2]) < FETCH_STEP_M) return;
    this.#fetchedAt = eye;
    this.#inner.land(eye, plan.radiusM);
  }

  /** Take an event; whether the stage is told of it. */
  #note(event: StreamEvent): boolean {
    if (event.type === "planned") {
      const facts = event.plan.show.map((row) => ({ ...row, bounds: this.#bounds.get(row.key) }));
      for (const { bounds, ...row } of facts) {
        if (bounds !== undefined && !row.isCoarser) this.#placed.set(row.segment, { ...row, bounds });
      }
      this.#newest = event.plan;
      if (event.plan.landing === this.#landing) this.#plan = event.plan;
    } else if (event.type === "arrived") {
      this.#bounds.set(event.key, event.bounds);
      const row = this.#newest?.show.find(({ key, isCoarser }) => key === event.key && !isCoarser);
      if (row !== undefined) this.#placed.set(row.segment, { ...row, bounds: event.bounds });
    } else if (event.type === "ready" && event.landing === this.#landing) {
      this.#isReady = true;
      this.#declared = null;
    } else if (event.type === "opened" && event.changed) {
      // Numbers of another version mean other segments.
      this.#placed.clear();
      this.#plan = null;
      this.#newest = null;
    }
    if (event.type === "planned") return event.plan.landing === this.#landing;
    return !("landing" in event) || event.landing === null || event.landing === this.#landing;
  }

  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    this.#inner.aim(position, radiusM, coarseRadiusM);
  }

  pick(origin: Vec3, direction?: Vec3): Promise<PickHit | null> {
    return this.#inner.pick(origin, direction);
  }

  mesh(key: SegmentKey, attributes: readonly AttributeScale[]): Promise<MeshData> {
    return this.#inner.mesh(key, attributes);
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
