/**
 * Picks that wait for an answer, over all connections of a session.
 *
 * PURE.
 */

import type { PickHit, Vec3 } from "../types.ts";
import type { ErrorMessage, HitPart, PickedMessage, PickMessage } from "../wire/messages.generated.ts";
import type { SessionEvent } from "./events.ts";

/** Asked again on the next connection until they are answered, refused or dropped. */
export class PickState {
  readonly #report: (event: SessionEvent) => void;
  readonly #unanswered = new Map<number, PickMessage>();

  constructor(report: (event: SessionEvent) => void) {
    this.#report = report;
  }

  /** How many wait. */
  get count(): number {
    return this.#unanswered.size;
  }

  /** The message that asks what lies along a ray. */
  ask(request: number, origin: Vec3, direction: Vec3 | undefined): PickMessage {
    const pick: PickMessage = { type: "pick", request, origin, direction };
    this.#unanswered.set(request, pick);
    return pick;
  }

  /** Those to ask again. */
  waiting(): PickMessage[] {
    return [...this.#unanswered.values()];
  }

  /** Forget one: its answer is skipped. */
  drop(request: number): void {
    this.#unanswered.delete(request);
  }

  answered(picked: PickedMessage): void {
    if (!this.#unanswered.delete(picked.request)) return;
    const hit = picked.hit === undefined ? null : hitOf(picked.hit);
    this.#report({ type: "pick-answered", request: picked.request, hit });
  }

  /** Take an error; whether it was one of a pick's. */
  refused(error: ErrorMessage): boolean {
    if (error.request === undefined || !this.#unanswered.delete(error.request)) return false;
    this.#report({ type: "pick-refused", request: error.request, code: error.code, message: error.message });
    return true;
  }
}

function hitOf(hit: HitPart): PickHit {
  return {
    position: hit.position,
    normal: hit.normal,
    segment: hit.segment,
    region: hit.region,
    stableId: hit.stable_id ?? null,
    label: hit.label ?? null,
    heightM: hit.height_m,
    attributes: hit.attributes,
  };
}
