/** What is loaded once for a version of a scene: manifest, base mesh, cover, names of the regions. */

import type { DecodeImage } from "../payload/glb.ts";
import type { SceneFiles, SceneSummary } from "../types.ts";

/** How to reach a server. */
export interface HttpOptions {
  /** Sent as `Authorization: Bearer`; without one no such header is sent. */
  readonly token?: string | undefined;
  readonly signal?: AbortSignal | undefined;
}

export interface LoadOptions extends HttpOptions {
  /** Scene version; the newest without it. */
  readonly version?: string | undefined;
  /** Bytes of base mesh, cover and regions that have come, of all. */
  readonly onProgress?: ((doneBytes: number, totalBytes: number) => void) | undefined;
  /** Decodes the base's image; without it a textured base has none. */
  readonly decodeImage?: DecodeImage | undefined;
}

/**
 * The scenes that a server shows.
 *
 * @param serverUrl Server URL or scene URL, http(s) or ws(s); a path before `/scenes` is kept.
 * @throws StreamError
 */
export function listScenes(_serverUrl: string, _options: HttpOptions = {}): Promise<SceneSummary[]> {
  throw new Error("on its way");
}

/**
 * Load everything of a scene that is loaded once, in this thread.
 *
 * @param sceneUrl Scene URL; or a server URL, whose only scene is meant.
 * @throws StreamError
 */
export function loadScene(_sceneUrl: string, _options: LoadOptions = {}): Promise<SceneFiles> {
  throw new Error("on its way");
}
