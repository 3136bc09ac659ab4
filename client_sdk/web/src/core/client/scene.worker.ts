/** Loads what a scene needs once, and is ended. */

import { loadScene } from "../scene/load.ts";
import { imageDecoder } from "./image-decoder.ts";
import { transferablesOfScene } from "./transferables.ts";
import { sentError } from "./worker-errors.ts";
import type { SceneJob, SceneMessage } from "./worker-messages.ts";

/** Between two reports: a bar moves smoothly enough. */
const PROGRESS_MS = 50;

function post(message: SceneMessage, transfer: Transferable[] = []): void {
  self.postMessage(message, { transfer });
}

self.onmessage = async (event: MessageEvent<SceneJob>) => {
  const { sceneUrl, token, version, wantsOverview } = event.data;
  let nextMs = 0;
  try {
    const files = await loadScene(sceneUrl, {
      token,
      version,
      decodeImage: imageDecoder(),
      onOverview: wantsOverview ? (files) => post({ type: "overview", files }, transferablesOfScene(files)) : undefined,
      onProgress: (doneBytes, totalBytes) => {
        if (performance.now() < nextMs && doneBytes < totalBytes) return;
        nextMs = performance.now() + PROGRESS_MS;
        post({ type: "progress", doneBytes, totalBytes });
      },
    });
    post({ type: "loaded", files }, transferablesOfScene(files));
  } catch (error) {
    post({ type: "failed", error: sentError(error) });
  }
};
