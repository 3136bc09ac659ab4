/**
 * What earlier landings showed, by what was asked for: a return is shown before the service has answered.
 *
 * The protocol promises that the same landing shows the same in one version and session (4, rules 4 and 10). The answer comes
 * all the same, and counts where it says otherwise.
 *
 * PURE.
 */

import type { LandOptions, PlanFacts, Vec3 } from "./types.ts";

/** Landings that are remembered; beyond it the one that was shown longest ago goes. Each is a list of ids. */
const MAX_REMEMBERED = 32;

/** What makes two landings the same: what may be waited for, and how long, decides nothing of the whole. */
export function landingKey(position: Vec3, radiusM: number, options: LandOptions = {}): string {
  return [...position, radiusM, options.coarseRadiusM ?? 0].join(" ");
}

/** Plans by {@link landingKey}, of landings that were shown whole. */
export class ShownBefore {
  readonly #plans = new Map<string, PlanFacts>();

  /** A landing was shown whole. */
  remember(key: string, plan: PlanFacts): void {
    this.#plans.delete(key);
    // Of a return nothing is to be loaded.
    this.#plans.set(key, { ...plan, show: plan.show.map((facts) => ({ ...facts, follows: false })), loadBytes: 0 });
    const [oldest] = this.#plans.keys();
    if (this.#plans.size > MAX_REMEMBERED && oldest !== undefined) this.#plans.delete(oldest);
  }

  /** The plan of a return; null where that landing was not shown lately. */
  recall(key: string, landing: number): PlanFacts | null {
    const plan = this.#plans.get(key);
    return plan === undefined ? null : { ...plan, landing };
  }

  forget(): void {
    this.#plans.clear();
  }
}
