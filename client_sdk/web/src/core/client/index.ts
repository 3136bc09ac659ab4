/**
 * Streams and scenes for a page: everything that talks to the server or decodes does so in workers.
 */

import type { SceneFiles, Stream, StreamOptions } from "../types.ts";

export type { DeviceBudgets, DeviceClass } from "../budgets.ts";
export { budgetsFor } from "../budgets.ts";

/** What {@link openDirectStream} may be given in place of what the platform has. */
export interface DirectParts {
  /** For platforms without a global WebSocket. */
  readonly WebSocket?: typeof WebSocket;
}

/** How {@link loadSceneInWorker} goes about it. */
export interface LoadSceneOptions {
  readonly token?: string;
  /** Version to ask for; the served one without it. */
  readonly version?: string;
  readonly onProgress?: (doneBytes: number, totalBytes: number) => void;
  readonly signal?: AbortSignal;
}

/** Open a stream in a worker of its own. Returns at once; set `onEvent` in the same task. */
export function openStream(options: StreamOptions): Stream {
  throw new Error(`not written yet: ${options.sceneUrl}`);
}

/** The same in the calling thread, for Node and for tests. */
export function openDirectStream(options: StreamOptions, parts: DirectParts = {}): Stream {
  throw new Error(`not written yet: ${options.sceneUrl} ${parts.WebSocket}`);
}

/** Load what a scene needs once, decoded in a worker. Rejects with StreamError, or with the signal's reason. */
export function loadSceneInWorker(sceneUrl: string, options: LoadSceneOptions = {}): Promise<SceneFiles> {
  return Promise.reject(new Error(`not written yet: ${sceneUrl} ${options.version}`));
}
