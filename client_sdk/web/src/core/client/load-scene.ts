/** What a scene needs once, fetched, checked and decoded in a worker. */

import type { SceneFiles } from "../types.ts";
import { receivedError, workerFailure } from "./worker-errors.ts";
import type { SceneJob, SceneMessage } from "./worker-messages.ts";

/** How {@link loadSceneInWorker} goes about it. */
export interface LoadSceneOptions {
  readonly token?: string | undefined;
  /** Version to ask for; the served one without it. */
  readonly version?: string | undefined;
  /** Called in the page's thread, at most twenty times a second. */
  readonly onProgress?: ((doneBytes: number, totalBytes: number) => void) | undefined;
  /** Called with what is to be shown until the promise is fulfilled, where the scene has that; see `loadScene`. */
  readonly onOverview?: ((files: SceneFiles) => void) | undefined;
  readonly signal?: AbortSignal | undefined;
}

/**
 * Load what a scene needs once, decoded in a worker that is ended afterwards.
 *
 * Rejects with StreamError, `worker_failed` included; with the signal's reason where it was aborted.
 */
export function loadSceneInWorker(sceneUrl: string, options: LoadSceneOptions = {}): Promise<SceneFiles> {
  const { token, version, onProgress, onOverview, signal } = options;
  return new Promise((resolve, reject) => {
    if (signal?.aborted) {
      reject(signal.reason);
      return;
    }
    const worker = new Worker(new URL("./scene.worker.ts", import.meta.url), {
      type: "module",
      name: "terraport scene",
    });
    const aborted = () => end(() => reject(signal?.reason));
    // Ended in every case: a worker of its own keeps what it decoded until then.
    const end = (settle: () => void) => {
      worker.terminate();
      signal?.removeEventListener("abort", aborted);
      settle();
    };
    signal?.addEventListener("abort", aborted);
    worker.onmessage = (event: MessageEvent<SceneMessage>) => {
      const message = event.data;
      if (message.type === "progress") onProgress?.(message.doneBytes, message.totalBytes);
      else if (message.type === "overview") onOverview?.(message.files);
      else if (message.type === "loaded") end(() => resolve(message.files));
      else end(() => reject(receivedError(message.error)));
    };
    worker.onerror = (event) => {
      event.preventDefault();
      end(() => reject(workerFailure("the scene's worker", event)));
    };
    worker.onmessageerror = (event) => end(() => reject(workerFailure("the scene's worker", event)));
    // A worker's addresses are relative to its script, not to the page.
    const job: SceneJob = {
      sceneUrl: new URL(sceneUrl, location.href).href,
      token,
      version,
      wantsOverview: onOverview !== undefined,
    };
    worker.postMessage(job);
  });
}
