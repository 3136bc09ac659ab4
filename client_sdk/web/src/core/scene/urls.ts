/**
 * Scene URLs, in every form that a user may paste, to the addresses behind them (protocol, sections 2 and 11): the rules of
 * `terraport.urls`.
 */

import { StreamError } from "./errors.ts";

/** Where a server, and perhaps one scene of it, is. */
export interface SceneUrl {
  /** `http(s)://host[:port][/prefix]` without a slash at the end. */
  readonly server: string;
  /** Scene id; null for a server URL, whose only scene is meant. */
  readonly scene: string | null;
}

const HTTP_OF: ReadonlyMap<string, string> = new Map([
  ["http:", "http:"],
  ["https:", "https:"],
  ["ws:", "http:"],
  ["wss:", "https:"],
]);
const SCENES = "/scenes";

/**
 * Read a scene URL or a server URL.
 *
 * @throws StreamError `invalid_url` if it is neither, or has credentials, a query or a fragment.
 */
export function parseSceneUrl(url: string): SceneUrl {
  const address = parsed(url);
  const scheme = address === null ? undefined : HTTP_OF.get(address.protocol);
  if (address === null || scheme === undefined || address.hostname === "") {
    throw invalid(`URL ${JSON.stringify(url)}, expected http(s)://host[:port][/prefix]/scenes/ID (or ws, wss)`);
  }
  if (address.username !== "" || address.password !== "" || address.search !== "" || address.hash !== "") {
    throw invalid(`URL of ${address.hostname} has credentials, a query or a fragment, expected none of them`);
  }
  const origin = `${scheme}//${address.host}`;
  const scenesAt = address.pathname.indexOf(SCENES);
  const prefix = scenesAt < 0 ? address.pathname : address.pathname.slice(0, scenesAt);
  const scenePath = scenesAt < 0 ? "" : address.pathname.slice(scenesAt + SCENES.length);
  const scene = scenePath.replace(/^\/+|\/+$/g, "").replace(/\/stream$/, "");
  if (scene === "") return { server: origin + prefix.replace(/\/+$/, ""), scene: null };
  if (scene.includes("/") || !scenePath.startsWith("/")) {
    throw invalid(`URL path ${JSON.stringify(address.pathname)}, expected [/prefix]/scenes/ID`);
  }
  return { server: origin + prefix, scene: decoded(scene) };
}

/** The URL of one scene: `http(s)://.../scenes/{id}`. `serverUrl` may be the URL of another scene of the server. */
export function sceneUrlOf(serverUrl: string, id: string): string {
  return `${parseSceneUrl(serverUrl).server}${SCENES}/${encoded(id)}`;
}

/**
 * Address of a scene's WebSocket; `group` names the group that the client will join.
 *
 * @throws StreamError `invalid_url` if the URL names no scene.
 */
export function streamUrl(sceneUrl: string, group?: string): string {
  const { server, scene } = parseSceneUrl(sceneUrl);
  if (scene === null) throw invalid(`${server} names no scene, expected .../scenes/ID`);
  const query = group === undefined ? "" : `?group=${encoded(group)}`;
  return `ws${server.slice("http".length)}${SCENES}/${encoded(scene)}/stream${query}`;
}

/** The URL's parts; null where it is none, or has no host: `URL` takes the first part of a path for one. */
function parsed(url: string): URL | null {
  if (!/^[a-z]+:\/\/[^/]/i.test(url)) return null;
  try {
    return new URL(url);
  } catch {
    return null;
  }
}

/** As Python's `quote(text, safe="")` does it. */
function encoded(text: string): string {
  return encodeURIComponent(text).replace(/[!'()*]/g, (mark) => `%${mark.charCodeAt(0).toString(16).toUpperCase()}`);
}

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    throw invalid(`scene id ${JSON.stringify(text)}, expected UTF-8 behind its percent signs`);
  }
}

function invalid(text: string): StreamError {
  return new StreamError("invalid_url", text);
}
