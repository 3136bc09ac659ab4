/** Scene URLs, in every form that a user may paste, to the addresses behind them (wire protocol, section 2.1). */

/** Where a server, and perhaps one scene of it, is. */
export interface SceneUrl {
  /** `http(s)://host[:port][/prefix]` without a slash at the end. */
  readonly server: string;
  /** Scene id; null for a server URL, whose only scene is meant. */
  readonly scene: string | null;
}

/**
 * Read a scene URL or a server URL.
 *
 * @throws StreamError `invalid_url` if it is neither, or has credentials, a query or a fragment.
 */
export function parseSceneUrl(_url: string): SceneUrl {
  throw new Error("on its way");
}

/** The URL of one scene: `http(s)://.../scenes/{id}`. */
export function sceneUrlOf(serverUrl: string, id: string): string {
  return `${parseSceneUrl(serverUrl).server}/scenes/${encodeURIComponent(id)}`;
}

/** Address of a scene's WebSocket; `group` names the group that the client will join. */
export function streamUrl(_sceneUrl: string, _group?: string): string {
  throw new Error("on its way");
}
