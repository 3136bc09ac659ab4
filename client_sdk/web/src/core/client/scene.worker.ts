/** Loads what a scene needs once, and is ended. */

import { loadScene } from "../scene/load.ts";
import { imageDecoder } from "./image-decoder.ts";
import { transferablesOfScene } from "./transferables.ts";
import { sentError } from "./worker-errors.ts";
import type { SceneJob, SceneNews } from "./worker-messages.ts";

/** Between two reports: a bar moves smoothly enough. */
const PROGRESS_MS = 50;

function say(news: SceneNews, transfer: Transferable[] = []): void {
  self.postMessage(news, { transfer });
}

self.onmessage = async (event: MessageEvent<SceneJob>) => {
  const { sceneUrl, token, version } = event.data;
  let nextMs = 0;
  try {
    const files = await loadScene(sceneUrl, {
      token,
      version,
      decodeImage: imageDecoder(),
      onProgress: (doneBytes, totalBytes) => {
        if (performance.now() < nextMs && doneBytes < totalBytes) return;
        nextMs = performance.now() + PROGRESS_MS;
        say({ type: "progress", doneBytes, totalBytes });
      },
    });
    say({ type: "loaded", files }, transferablesOfScene(files));
  } catch (error) {
    say({ type: "failed", error: sentError(error) });
  }
};
