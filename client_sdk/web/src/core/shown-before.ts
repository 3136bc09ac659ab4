/**
 * What earlier landings showed, by what was asked for: who comes back is shown it before the service has answered.
 *
 * The wire protocol promises (6.6, rule 2) that the same landing shows the same whatever was before; so what its `ready` said
 * holds again, in one session and for one scene version. The answer comes all the same, and counts where it says otherwise.
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

  /** Landing `key` was shown: exactly these, ascending. */
  remember(key: string, plan: PlanFacts, visible: readonly number[]): void {
    this.#plans.delete(key);
    // Of a return nothing is to be loaded; what is nearby only its own plan can say.
    this.#plans.set(key, { ...plan, load: [], keep: visible, nearby: [], loadBytes: 0 });
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
