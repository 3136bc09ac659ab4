/** The way into the headset and back. Its code is loaded only where there is a headset. */

import type { StreamEvent } from "../../core/types.ts";
import type { HeadsetOptions, HeadsetSession, Tone } from "../../xr/types.ts";

/** Forwards to the headset's session while there is one, and does nothing otherwise. */
export interface HeadsetEntry {
  readonly session: HeadsetSession | null;
  /** To be called straight from a click. */
  enter(options: HeadsetOptions): Promise<void>;
  handle(event: StreamEvent): void;
  message(text: string, tone: Tone): void;
  end(): void;
}

/** Ask the browser; `supported` is called once, and only with a headset. */
export function createHeadsetEntry(supported: () => void): HeadsetEntry {
  let headset: typeof import("../../xr/headset.ts") | null = null;
  let session: HeadsetSession | null = null;

  async function look(): Promise<void> {
    if (!("xr" in navigator) || navigator.xr === undefined) return;
    if (!(await navigator.xr.isSessionSupported("immersive-vr"))) return;
    // Loaded before the click: a browser lets a page in only while the click is fresh.
    headset = await import("../../xr/headset.ts");
    if (await headset.headsetSupported()) supported();
  }
  // A policy of an embedding page may forbid the question: then there is no headset.
  look().catch(() => undefined);

  return {
    get session() {
      return session?.active ? session : null;
    },
    async enter(options) {
      if (headset === null || session?.active) return;
      session = await headset.enterHeadset(options);
    },
    handle: (event) => session?.active && session.handle(event),
    message: (text, tone) => session?.active && session.message(text, tone),
    end() {
      if (session?.active) session.end().catch(() => undefined);
    },
  };
}
