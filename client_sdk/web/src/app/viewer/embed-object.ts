/** Puts `window.terraport` together. */

import { version } from "../../../package.json";
import type { RegionFacts } from "../../core/types.ts";
import type { Stage } from "../../three/stage.ts";
import type { GroundHit, LandingStatus } from "../../three/types.ts";
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
  readonly stage: Stage;
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

/** A link may be down for so long before whoever waits for a landing is told. */
const LINK_PATIENCE_MS = 15_000;

/** Build the object; it is the viewer that makes it global, and takes it away. */
export function createEmbed(sources: EmbedSources): Embed {
  const { store, stage, world, camera, desk, going, notices, headset, listeners, loop } = sources;
  const { cast, frameTimes, nextFrame } = sources;

  const diagnostics = () =>
    readDiagnostics({
      renderer: world.renderer,
      state: store.get(),
      stats: stage.stats(),
      visible: stage.visible,
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
      return stage.visible;
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
      return new Promise((resolve, reject) => {
        let timer: number | null = null;
        const landing = going.land({ position, radiusM, look: null, isEntry: true, goes: false }, options);
        // Settled by state, not by events: also where the landing was replaced by one of the user's.
        const settle = () => {
          const { status } = stage;
          const { link } = store.get();
          // Of a return the picture is there before the service's word.
          const isWhole = status.phase === "shown" && status.readyMs !== null;
          const isOpen = status.landing === landing && !isWhole && status.phase !== "refused";
          if (isOpen && link?.state !== "closed") {
            if (link?.state === "open" && timer !== null) {
              window.clearTimeout(timer);
              timer = null;
            } else if (link?.state !== "open") timer ??= window.setTimeout(giveUp, LINK_PATIENCE_MS);
            return;
          }
          stop();
          if (timer !== null) window.clearTimeout(timer);
          if (isOpen && link?.state === "closed")
            reject(new Error(`the link is closed (${link.code}): ${link.message}`));
          else if (status.landing !== landing)
            reject(new Error(`landing ${landing} was superseded by ${status.landing}`));
          else if (status.phase === "refused") reject(new Error(status.refusal ?? "the landing was refused"));
          else resolve(status satisfies LandingStatus);
        };
        const stop = store.subscribe(settle);
        const giveUp = () => {
          stop();
          reject(new Error(`no link for ${LINK_PATIENCE_MS / 1000} s; landing ${landing} waits for it`));
        };
        settle();
        loop.request();
      });
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
