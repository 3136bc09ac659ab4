/**
 * `window.terraport`: the viewer for pages that embed it, for support, and for tests that drive the page as a user would.
 *
 * Everything here does what a control of the page does, or tells what the page knows. Documented in the package's README.
 */

import type { LandOptions, StreamEvent, Vec3 } from "../../core/types.ts";
import type { GroundHit, LandingStatus, SwapReport, TerrainStats, ViewMode, VisibleDigest } from "../../three/types.ts";
import type { HeadsetSession } from "../../xr/types.ts";
import type { FreePose } from "./camera-desk.ts";
import type { ViewerState } from "./state.ts";

/** What can be listened to. */
export interface EmbedEvents {
  /** Everything that the stream tells. */
  readonly stream: StreamEvent;
  /** What is visible has changed. */
  readonly swap: SwapReport;
  /** The viewer's state has changed. */
  readonly state: ViewerState;
}

/** The object. There is one while a scene is open; `undefined` on the list of scenes. */
export interface Embed {
  readonly version: string;
  readonly scene: string;
  readonly state: ViewerState;
  readonly status: LandingStatus;
  /** Equal strings: the same segments and the same hidden base faces. */
  readonly visibleDigest: VisibleDigest;
  readonly visible: readonly number[];
  readonly stats: TerrainStats;
  /** Milliseconds of recent frames, oldest first. */
  readonly frameTimes: readonly number[];
  /** Frames drawn since the scene was opened. */
  readonly frames: number;
  /** Land; `radiusM` and the place's height may be left to the page. Resolves when it is shown whole; rejects when refused, or
   * superseded, or where the link is closed for good, or down for longer than 15 s: the landing itself is shown all the same
   * when there is a link again. */
  land(position: Vec3, radiusM?: number, options?: LandOptions): Promise<LandingStatus>;
  aim(position: Vec3, radiusM?: number): void;
  /** A mode, or its text, as `slope` or `attribute:NAME`; throws RangeError on what is no mode of this scene. */
  setMode(mode: ViewMode | string): void;
  setView(view: "orbit" | "walk"): void;
  /** Put the eye anywhere; null gives it back to the user. Resolves after the frame was drawn. */
  look(pose: FreePose | null): Promise<void>;
  /** The picture as it is now: PNG. */
  picture(): Promise<Blob>;
  /** The first ground of what is shown along a ray; null where there is none. */
  cast(origin: Vec3, direction: Vec3): GroundHit | null;
  /** The session while a headset is worn. */
  readonly headset: HeadsetSession | null;
  diagnostics(): Promise<object>;
  /** Returns how to stop listening. */
  on<Name extends keyof EmbedEvents>(name: Name, listener: (event: EmbedEvents[Name]) => void): () => void;
}

declare global {
  interface Window {
    terraport?: Embed | undefined;
  }
}

/** Who listens to what. */
export interface EmbedListeners {
  on: Embed["on"];
  emit<Name extends keyof EmbedEvents>(name: Name, event: EmbedEvents[Name]): void;
}

const EVENTS: readonly (keyof EmbedEvents)[] = ["stream", "swap", "state"];

/** Make the list of listeners, empty. */
export function createEmbedListeners(): EmbedListeners {
  const listeners = new Map<keyof EmbedEvents, Set<(event: never) => void>>();
  return {
    on(name, listener) {
      if (!EVENTS.includes(name)) throw new RangeError(`got event "${name}", expected one of ${EVENTS.join(", ")}`);
      const set = listeners.get(name) ?? new Set();
      listeners.set(name, set);
      set.add(listener as (event: never) => void);
      return () => set.delete(listener as (event: never) => void);
    },
    emit(name, event) {
      for (const listener of listeners.get(name) ?? []) {
        try {
          (listener as (event: unknown) => void)(event);
        } catch (error) {
          // An embedding page's mistake is its own: told like any of its errors, and the viewer goes on.
          window.reportError(error);
        }
      }
    },
  };
}
