/**
 * The comfort rule, watched while it runs: what is visible changes in a swap, and nowhere else.
 *
 * Swaps are counted as the terrain reports them; the digest of what is drawn is compared in every frame.
 */

import type { Terrain } from "../../three/terrain.ts";
import type { SwapReport } from "../../three/types.ts";
import type { ViewerStore } from "./state.ts";

/** Counts changes of what is visible, those outside a swap apart. */
export interface ComfortWatch {
  /** Once per frame, after everything that could change something. */
  check(): void;
  /** A new version was opened, or the graphics device is back: what is visible begins anew, and is no stray change. */
  restart(): void;
}

/** Watch a terrain. `onSwap` is called after every swap. */
export function watchComfort(stage: Terrain, store: ViewerStore, onSwap: (report: SwapReport) => void): ComfortWatch {
  let digest = stage.visibleDigest();

  stage.addEventListener("swapped", ({ report }) => {
    const newDigest = stage.visibleDigest();
    const { swaps, visibleChanges } = store.get();
    store.set({ swaps: swaps + 1, visibleChanges: visibleChanges + (newDigest === digest ? 0 : 1) });
    digest = newDigest;
    onSwap(report);
  });
  return {
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
