/** What is loaded once for a version of a scene: manifest, base mesh, names of the regions. A shell: it fetches. */

import { PayloadError } from "../payload/errors.ts";
import type { DecodeImage } from "../payload/image-file.ts";
import { decodeSegment } from "../payload/segment-format.ts";
import type { AttributeScale, MeshData, SceneFiles } from "../types.ts";
import { StreamError } from "./errors.ts";
import type { HttpOptions } from "./http.ts";
import { fetchBytes, fetchJson, parseJson } from "./http.ts";
import { listScenes } from "./list.ts";
import type { CheckedManifest, FileFacts, LoadedFile } from "./manifest.ts";
import { checkManifest, OVERVIEW } from "./manifest.ts";
import type { Labels } from "./regions.ts";
import { readLabels, readRegions, readUnions } from "./regions.ts";
import { parseSceneUrl, sceneUrlOf } from "./urls.ts";

export type { HttpOptions } from "./http.ts";
export { listScenes, type SceneList } from "./list.ts";

/** How a scene is loaded. */
export interface LoadOptions extends HttpOptions {
  /** Scene version; the newest without it. */
  readonly version?: string | undefined;
  /** Bytes of base mesh and regions that have come, of all. Starts anew where the scene was published meanwhile. */
  readonly onProgress?: ((doneBytes: number, totalBytes: number) => void) | undefined;
  /**
   * Called with what is to be shown before the base is here, where the scene has that. The base is asked for afterwards; where
   * the scene was published meanwhile, it may be of another version.
   */
  readonly onOverview?: ((files: SceneFiles) => void) | undefined;
  /** Decodes the base's image; without it a textured base has none. */
  readonly decodeImage?: DecodeImage | undefined;
}

/**
 * Load everything of a scene that is loaded once, in this thread.
 *
 * @param sceneUrl Scene URL; or a server URL, whose only scene is meant.
 * @throws StreamError With an error code of the protocol where the server refuses, else one of those named there.
 * @throws The signal's reason where it is aborted.
 */
export async function loadScene(sceneUrl: string, options: LoadOptions = {}): Promise<SceneFiles> {
  const url = await resolveScene(sceneUrl, options);
  const checked = await fetchManifest(url, options);
  try {
    return await loadVersion(url, checked, options);
  } catch (error) {
    // Published anew between the manifest and its files (scene format, section 2): start over, once.
    if (!(error instanceof StreamError) || options.version !== undefined) throw error;
    if (error.status !== 404 && error.code !== "damaged") throw error;
    const newer = await fetchManifest(url, options);
    if (newer.manifest.version === checked.manifest.version) throw error;
    return loadVersion(url, newer, options);
  }
}

/** The URL of the scene; a server URL stands for its only scene. */
async function resolveScene(sceneUrl: string, options: HttpOptions): Promise<string> {
  const { server, scene } = parseSceneUrl(sceneUrl);
  if (scene !== null) return sceneUrlOf(server, scene);
  const { scenes } = await listScenes(server, options);
  const [onlyScene] = scenes;
  if (onlyScene !== undefined && scenes.length === 1) return sceneUrlOf(server, onlyScene.id);
  const ids = scenes.map((scene) => scene.id).join(", ") || "none";
  const text = `${server} serves ${scenes.length} scenes (${ids}), expected one: name it as .../scenes/ID`;
  throw new StreamError("several_scenes", text);
}

async function fetchManifest(url: string, options: LoadOptions): Promise<CheckedManifest> {
  const json = await fetchJson(versioned(url, options.version), options);
  return checkManifest(json, parseSceneUrl(url).scene ?? "");
}

/**
 * All files of the manifest's version, or none. Each is asked for by `?v=` and must have the length that the manifest says.
 */
async function loadVersion(url: string, checked: CheckedManifest, options: LoadOptions): Promise<SceneFiles> {
  const { manifest, files } = checked;
  // One that fails must not leave the others loading.
  const abort = new AbortController();
  const signal = options.signal === undefined ? abort.signal : AbortSignal.any([options.signal, abort.signal]);
  const { onOverview } = options;
  const overview = onOverview === undefined ? undefined : checked.overview;
  const allFiles = [...Object.values(files), ...(overview === undefined ? [] : [overview])];
  const totalBytes = allFiles.reduce((total, file) => total + file.bytes, 0);
  let doneBytes = 0;

  const load = async (key: LoadedFile | typeof OVERVIEW, facts: FileFacts): Promise<Uint8Array<ArrayBuffer>> => {
    const { bytes: maxBytes } = facts;
    const onBytes = (bytes: number) => {
      doneBytes += bytes;
      options.onProgress?.(doneBytes, totalBytes);
    };
    const address = versioned(`${url}/${key}`, manifest.version);
    const request = { token: options.token, signal };
    return fetchBytes(address, request, { maxBytes, isExact: true, onBytes });
  };

  try {
    options.onProgress?.(0, totalBytes);
    const said = async () => {
      const [bytes, labels] = await Promise.all([
        load("regions.json", files["regions.json"]),
        fetchLabels(`${url}/labels.json`, { token: options.token, signal }),
      ]);
      const document = parseJson(bytes, `${url}/regions.json`);
      return { regions: readRegions(document, labels), unions: readUnions(document) };
    };
    const regions = said();
    // Awaited below, where it counts: until then a failure is nobody's.
    regions.catch(() => undefined);
    // Before the base, not beside it: what is shown first has the link to itself.
    if (overview !== undefined && onOverview !== undefined) {
      const first = await decodedOverview(load(OVERVIEW, overview), manifest.attributes, options.decodeImage);
      if (first !== null) {
        onOverview({ manifest, base: first, ...(await regions), isOverview: true });
      }
    }
    const [bytes, facts] = await Promise.all([load("base.tsg", files["base.tsg"]), regions]);
    // Right bytes may still hold a wrong file: base and hidden faces must belong together.
    const base = await decodeSegment(bytes, manifest.attributes, options.decodeImage, "base");
    if (base.faceCount !== checked.baseFaces) {
      throw new PayloadError(`base of ${base.faceCount} faces, expected ${checked.baseFaces} by the manifest`);
    }
    return { manifest, base, ...facts };
  } catch (error) {
    abort.abort();
    if (!(error instanceof PayloadError)) throw error;
    const text = `scene ${manifest.id}, version ${manifest.version}: ${error.message}; it must be published anew`;
    throw new StreamError("damaged", text, undefined, { cause: error });
  }
}

/** The overview; null where it cannot be had: the base will be the first picture. */
async function decodedOverview(
  bytes: Promise<Uint8Array<ArrayBuffer>>,
  attributes: readonly AttributeScale[],
  decodeImage: DecodeImage | undefined,
): Promise<MeshData | null> {
  try {
    return await decodeSegment(await bytes, attributes, decodeImage, "base");
  } catch (error) {
    if (error instanceof StreamError || error instanceof PayloadError) return null;
    throw error;
  }
}

/** Labels as they are now. Whatever is wrong with them, the ground is there without. */
async function fetchLabels(url: string, options: HttpOptions): Promise<Labels> {
  try {
    return readLabels(await fetchJson(url, options));
  } catch (error) {
    if (error instanceof StreamError) return new Map();
    throw error;
  }
}

function versioned(url: string, version: string | undefined): string {
  return version === undefined ? url : `${url}?v=${encodeURIComponent(version)}`;
}
