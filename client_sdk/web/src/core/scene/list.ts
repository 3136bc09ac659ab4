/** GET /scenes: what a server shows. A shell: it fetches. */

import type { BuildingScene, SceneSummary } from "../types.ts";
import { StreamError } from "./errors.ts";
import type { HttpOptions } from "./http.ts";
import { fetchJson } from "./http.ts";
import { parseSceneUrl, sceneUrlOf } from "./urls.ts";

/** The scenes that a token opens, and the pages beside them. */
export interface SceneList {
  readonly scenes: readonly SceneSummary[];
  /** What is being built just now. */
  readonly building: readonly BuildingScene[];
  /** Address by name (`docs`, `metrics`), each only where it answers. */
  readonly links: Readonly<Record<string, string>>;
}

/**
 * List the scenes of a server.
 *
 * @param serverUrl Server URL or scene URL, http(s) or ws(s); a path before `/scenes` is kept.
 * @throws StreamError `unauthorised` where the server asks for a token; else as `loadScene`.
 */
export async function listScenes(serverUrl: string, options: HttpOptions = {}): Promise<SceneList> {
  const { server } = parseSceneUrl(serverUrl);
  const url = `${server}/scenes`;
  const { scenes, building, links } = await fetchJson(url, options);
  if (!Array.isArray(scenes)) {
    throw new StreamError("damaged", `${url} lists no scenes; is this a terraport server?`, 200);
  }
  return {
    scenes: scenes.map((line: unknown) => readLine(line, server, url)),
    building: Array.isArray(building) ? building.flatMap(readBuilding) : [],
    // Addresses are relative to the server, which may stand behind a prefix.
    links: Object.fromEntries(textsOf(links).map(([name, path]) => [name, `${server}/${path}`])),
  };
}

function readLine(line: unknown, server: string, url: string): SceneSummary {
  const { id, name, version, segments, detail_faces: detailFaces, links } = (line ?? {}) as Record<string, unknown>;
  if (typeof id !== "string" || id === "" || typeof version !== "string") {
    throw new StreamError("damaged", `${url} lists a scene without id or version`, 200);
  }
  const linked = new Set(textsOf(links).map(([key]) => key));
  return {
    id,
    name: typeof name === "string" && name !== "" ? name : id,
    version,
    segments: typeof segments === "number" ? segments : 0,
    detailFaces: typeof detailFaces === "number" ? detailFaces : 0,
    reportUrl: linked.has("report") ? `${sceneUrlOf(server, id)}/report` : "",
    reportPdfUrl: linked.has("report_pdf") ? `${sceneUrlOf(server, id)}/report.pdf` : "",
    previewUrl: linked.has("preview") ? `${sceneUrlOf(server, id)}/preview.jpg` : "",
  };
}

/** A line that is not understood is left out: the scene comes to the list anyhow. */
function readBuilding(line: unknown): BuildingScene[] {
  const { id, name, step, share } = (line ?? {}) as Record<string, unknown>;
  if (typeof id !== "string" || id === "" || typeof step !== "string") return [];
  const isShare = typeof share === "number" && share >= 0 && share <= 1;
  return [{ id, name: typeof name === "string" && name !== "" ? name : id, step, share: isShare ? share : null }];
}

function textsOf(links: unknown): [string, string][] {
  if (typeof links !== "object" || links === null) return [];
  return Object.entries(links).filter((entry): entry is [string, string] => typeof entry[1] === "string");
}
