/** Aims and landings of the page: from a click to the swap, and what is said about it. */

import type { LandOptions, StreamEvent, Vec3 } from "../../core/types.ts";
import type { LandingStatus, Landings } from "../../three/types.ts";
import type { Look } from "../route.ts";
import type { Landed, ViewerStore } from "./state.ts";

/** The part of the drawn scene that is used. */
export type LandingStage = Pick<Landings, "status" | "shownSegments" | "land" | "prefetch" | "swap">;

/** What to do around a swap. */
export interface LandingDeskOptions {
  readonly store: ViewerStore;
  readonly stage: LandingStage;
  /** Calls `swap` in a frame in which the user may not see the change, and nothing else before it returns. */
  readonly unseen: (swap: () => void) => void;
  /** The first swap of a landing was made: the user goes there. In the same frame. */
  readonly arrived: (order: LandingOrder) => void;
  /** Something was shown. */
  readonly shown: (landed: Landed, order: LandingOrder, isCompletion: boolean) => void;
}

/** A landing to ask for, and what becomes of camera and history when it is shown. */
export interface LandingOrder {
  readonly position: Vec3;
  readonly radiusM: number;
  /** How to look when there; null keeps the look. */
  readonly look: Look | null;
  /** Whether it becomes an entry of the browser's history. */
  readonly isEntry: boolean;
  /** The user pointed there: he is taken there, and shown what became sharp. */
  readonly goes: boolean;
}

/** Follows the newest landing from the order to its swap; older orders are forgotten. */
export interface LandingDesk {
  aim(position: Vec3, radiusM: number): void;
  cancelAim(): void;
  /** The promise is that of `Terrain.land`. */
  land(order: LandingOrder, options?: LandOptions): Promise<LandingStatus>;
  handle(event: StreamEvent): void;
  /** Once per frame: swaps when there is something to show. True while a landing is under way. */
  update(): boolean;
}

/** A desk without an order. `update` is to be called in every frame, before the scene is drawn. */
export function createLandingDesk({ store, stage, unseen, arrived, shown }: LandingDeskOptions): LandingDesk {
  let order: LandingOrder | null = null;
  let hasArrived = false;
  let swapPending = false;

  /** In a frame in which the user may not see it: set, camera and state change together. */
  function swapNow(): void {
    swapPending = false;
    // Read before the swap: afterwards the status is that of what is shown.
    const statusBefore = stage.status;
    const report = stage.swap();
    if (report === null || order === null) return;
    const isCompletion = hasArrived;
    // Moved with the first swap alone: at the completion of a degraded one he may have gone on.
    if (!hasArrived) arrived(order);
    hasArrived = true;
    const { plan } = statusBefore;
    const landed: Landed = {
      place: statusBefore.position,
      radiusM: statusBefore.radiusM,
      effectiveRadiusM: plan?.effectiveRadiusM ?? statusBefore.radiusM,
      coarseRadiusM: plan?.coarseRadiusM ?? null,
      segments: plan === null ? report.shown.length : plan.show.length - statusBefore.missing.length,
      triangles: plan?.totalTriangles ?? 0,
      bytes: statusBefore.payloadBytes,
      readyMs: statusBefore.readyMs,
      shownMs: statusBefore.presentableMs,
      degraded: report.degraded,
      missing: statusBefore.missing.length,
      omittedBy: plan?.omittedBy ?? null,
    };
    store.set({ landed, landing: stage.status });
    shown(landed, order, isCompletion);
  }

  return {
    aim(position, radiusM) {
      store.set({ aim: { place: position, radiusM, bytes: 0 } });
      stage.prefetch(position, radiusM);
    },
    cancelAim() {
      store.set({ aim: null });
    },
    land(next, options) {
      order = next;
      hasArrived = false;
      store.set({ aim: null });
      const landing = stage.land(next.position, next.radiusM, options);
      store.set({ landing: stage.status });
      return landing;
    },
    handle(event) {
      const { aim } = store.get();
      if (aim === null) return;
      if (event.type === "arrived" && event.landing === null) {
        store.set({ aim: { ...aim, bytes: aim.bytes + event.bytes } });
      }
    },
    update() {
      const { status } = stage;
      // The same facts in a new object are no news.
      if (!isSame(status, store.get().landing)) {
        const { landed } = store.get();
        // A return is shown before the service has answered: how long that took comes behind.
        const answered = landed?.readyMs === null && status.phase === "shown" && status.readyMs !== null;
        const news = answered ? { landed: { ...landed, readyMs: status.readyMs, bytes: status.payloadBytes } } : {};
        store.set({ landing: status, ...news });
      }
      const { phase } = status;
      if ((phase === "presentable" || phase === "degraded-presentable") && !swapPending) {
        // Once: `unseen` may take frames to get dark.
        swapPending = true;
        unseen(swapNow);
      }
      return swapPending || phase === "planning" || phase === "streaming";
    },
  };
}

function isSame(a: LandingStatus, b: LandingStatus | null): boolean {
  return (
    b !== null &&
    a.landing === b.landing &&
    a.phase === b.phase &&
    a.fraction === b.fraction &&
    a.plan === b.plan &&
    a.readyMs === b.readyMs &&
    a.refusal === b.refusal
  );
}
