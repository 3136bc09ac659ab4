/** Puts `window.terraport` together from the viewer's parts. */

import { version } from "../../../package.json";
import type { LandingStatus } from "../../three/types.ts";
import { readDiagnostics } from "./diagnostics.ts";
import type { Embed } from "./embed.ts";
import type { Parts } from "./parts.ts";

/** What only the viewer itself knows. */
export interface EmbedSources {
  readonly frameTimes: readonly number[];
  /** Resolves after the next frame was drawn. */
  nextFrame(): Promise<void>;
}

/** Make the object. */
export function createEmbed(parts: Parts, { frameTimes, nextFrame }: EmbedSources): Embed {
  const { store, stage, desk, going, world, listeners, loop, notices, headset } = parts;

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
        const landing = going.land({ place: position, radiusM, look: null, isEntry: true }, options);
        const stop = store.subscribe(() => {
          const { status } = stage;
          if (status.landing === landing && status.phase !== "shown" && status.phase !== "refused") return;
          stop();
          if (status.landing !== landing) reject(new Error(`landing ${landing} was superseded by ${status.landing}`));
          else if (status.phase === "refused") reject(new Error(status.refusal ?? "the landing was refused"));
          else resolve(status satisfies LandingStatus);
        });
        loop.request();
      });
    },
    aim: (position, radiusM = store.get().radiusM) => desk.aim(position, radiusM),
    setMode: (mode) => store.set({ mode }),
    setView: going.setView,
    async look(pose) {
      parts.camera.setFree(pose);
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
    cast: (origin, direction) => parts.cast({ origin, direction }),
    diagnostics: async () => diagnostics(),
    on: listeners.on,
  };
}
