/**
 * The comfort rule, watched while it runs: what is visible changes in a swap, and nowhere else.
 *
 * Every swap, the page's and the headset's, goes through the `landings` made here; the digest of what is drawn is compared
 * in every frame.
 */

import type { Terrain } from "../../three/terrain.ts";
import type { Landings, SwapReport } from "../../three/types.ts";
import { coarseRadiusIn } from "./land-options.ts";
import type { ViewerStore } from "./state.ts";

/** Counts changes of what is visible, those outside a swap apart. */
export interface ComfortWatch {
  /** The stage's own, with every swap counted. */
  readonly landings: Landings;
  /** Once per frame, after everything that could change something. */
  check(): void;
  /** A new version was opened, or the graphics device is back: what is visible begins anew, and is no stray change. */
  restart(): void;
}

/** Watch a stage. `onSwap` is called after every one that changed something. */
export function watchComfort(stage: Terrain, store: ViewerStore, onSwap: (report: SwapReport) => void): ComfortWatch {
  let digest = stage.visibleDigest();

  return {
    landings: {
      get status() {
        return stage.status;
      },
      get bounds() {
        return stage.bounds;
      },
      land: (position, radiusM, options) => stage.land(position, radiusM, options),
      prefetch: (position, radiusM) => stage.prefetch(position, radiusM, coarseRadiusIn(store.get(), radiusM)),
      cast: (origin, direction, maxDistanceM) => stage.cast(origin, direction, maxDistanceM),
      groundAt: (x, z, fromY) => stage.groundAt(x, z, fromY),
      swap() {
        const report = stage.swap();
        if (report === null) return null;
        const newDigest = stage.visibleDigest();
        const { swaps, visibleChanges } = store.get();
        store.set({ swaps: swaps + 1, visibleChanges: visibleChanges + (newDigest === digest ? 0 : 1) });
        digest = newDigest;
        onSwap(report);
        return report;
      },
    },
    check() {
      const newDigest = stage.visibleDigest();
      if (newDigest === digest) return;
      digest = newDigest;
      const { visibleChanges, strayChanges } = store.get();
      store.set({ visibleChanges: visibleChanges + 1, strayChanges: strayChanges + 1 });
    },
    restart() {
      digest = stage.visibleDigest();
    },
  };
}
