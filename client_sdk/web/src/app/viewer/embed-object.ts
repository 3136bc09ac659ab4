/** Puts `window.terraport` together. */

import { version } from "../../../package.json";
import type { RegionFacts } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import type { GroundHit } from "../../three/types.ts";
import { modeFrom } from "../../three/view-modes.ts";
import type { CameraDesk, Ray } from "./camera-desk.ts";
import { readDiagnostics } from "./diagnostics.ts";
import type { Embed, EmbedListeners } from "./embed.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { Going } from "./going.ts";
import type { HeadsetEntry } from "./headset-entry.ts";
import type { LandingDesk } from "./landing-desk.ts";
import type { Notices } from "./notices.ts";
import type { ViewerStore } from "./state.ts";
import type { World } from "./world.ts";

/** Modules behind the members of `window.terraport`. */
export interface EmbedSources {
  readonly store: ViewerStore;
  readonly regions: readonly RegionFacts[];
  readonly stage: Terrain;
  readonly world: World;
  readonly camera: CameraDesk;
  readonly desk: LandingDesk;
  readonly going: Going;
  readonly notices: Notices;
  readonly headset: HeadsetEntry;
  readonly listeners: EmbedListeners;
  readonly loop: FrameLoop;
  /** The ground along a ray, as far as anything is shown. */
  cast(ray: Ray): GroundHit | null;
  readonly frameTimes: readonly number[];
  /** Resolves after the next frame was drawn. */
  nextFrame(): Promise<void>;
}

/** Build the object; it is the viewer that makes it global, and takes it away. */
export function createEmbed(sources: EmbedSources): Embed {
  const { store, stage, world, camera, desk, going, notices, headset, listeners, loop } = sources;
  const { cast, frameTimes, nextFrame } = sources;

  const diagnostics = () =>
    readDiagnostics({
      renderer: world.renderer,
      state: store.get(),
      stats: stage.stats(),
      visible: stage.shownSegments,
      visibleDigest: stage.visibleDigest(),
      frameTimes,
      notices: notices.current,
    });

  return {
    version,
    scene: store.get().manifest.id,
    get state() {
      return store.get();
    },
    get status() {
      return stage.status;
    },
    get visibleDigest() {
      return stage.visibleDigest();
    },
    get visible() {
      return stage.shownSegments;
    },
    get stats() {
      return stage.stats();
    },
    get headset() {
      return headset.session;
    },
    frameTimes,
    get frames() {
      return loop.count;
    },
    land(position, radiusM = store.get().radiusM, options) {
      return going.land({ position, radiusM, look: null, isEntry: true, goes: false }, options);
    },
    aim: (position, radiusM = store.get().radiusM) => desk.aim(position, radiusM),
    setMode: (mode) => store.set({ mode: modeFrom(mode, store.get().manifest, sources.regions) }),
    setView(view) {
      if (view !== "orbit" && view !== "walk") throw new RangeError(`got view "${view}", expected orbit or walk`);
      going.setView(view);
    },
    async look(pose) {
      camera.setFree(pose);
      await nextFrame();
    },
    async picture() {
      const frame = nextFrame();
      loop.request();
      await frame;
      // Drawn in this task: the buffer is not kept beyond it.
      world.render();
      return new Promise((resolve, reject) => {
        world.canvas.toBlob((blob) => (blob === null ? reject(new Error("no picture")) : resolve(blob)), "image/png");
      });
    },
    cast: (origin, direction) => cast({ origin, direction }),
    diagnostics: async () => diagnostics(),
    on: listeners.on,
  };
}
