/** What is loaded once for a version of a scene: manifest, base mesh, cover, names of the regions. A shell: it fetches. */

import { decodeCover } from "../payload/cover.ts";
import { prepareDecoders, xxh3 } from "../payload/engines.ts";
import { PayloadError } from "../payload/errors.ts";
import type { DecodeImage } from "../payload/glb.ts";
import { decodeGlb } from "../payload/glb.ts";
import type { SceneFiles } from "../types.ts";
import { StreamError } from "./errors.ts";
import type { HttpOptions } from "./http.ts";
import { fetchBytes, fetchJson, parseJson } from "./http.ts";
import { listScenes } from "./list.ts";
import type { CheckedManifest, LoadedFile } from "./manifest.ts";
import { checkManifest } from "./manifest.ts";
import type { Labels } from "./regions.ts";
import { readLabels, readRegions, readUnions } from "./regions.ts";
import { parseSceneUrl, sceneUrlOf } from "./urls.ts";

export type { HttpOptions } from "./http.ts";
export { listScenes, type SceneList } from "./list.ts";

/** How a scene is loaded. */
export interface LoadOptions extends HttpOptions {
  /** Scene version; the newest without it. */
  readonly version?: string | undefined;
  /** Bytes of base mesh, cover and regions that have come, of all. Starts anew where the scene was published meanwhile. */
  readonly onProgress?: ((doneBytes: number, totalBytes: number) => void) | undefined;
  /** Decodes the base's image; without it a textured base has none. */
  readonly decodeImage?: DecodeImage | undefined;
}

/**
 * Load everything of a scene that is loaded once, in this thread. Every file is compared with its hash.
 *
 * @param sceneUrl Scene URL; or a server URL, whose only scene is meant.
 * @throws StreamError With the code of the wire protocol where the server refuses, else one of those named there.
 * @throws The signal's reason where it is aborted.
 */
export async function loadScene(sceneUrl: string, options: LoadOptions = {}): Promise<SceneFiles> {
  const url = await resolveScene(sceneUrl, options);
  await prepareDecoders();
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
 * All files of the manifest's version, or none. Each is asked for by `?v=` and compared with the manifest's hash: what a proxy
 * or a publication in between has mixed is refused here (wire protocol, 2.5, rule 2).
 */
async function loadVersion(url: string, checked: CheckedManifest, options: LoadOptions): Promise<SceneFiles> {
  const { manifest, files } = checked;
  // One that fails must not leave the others loading.
  const abort = new AbortController();
  const signal = options.signal === undefined ? abort.signal : AbortSignal.any([options.signal, abort.signal]);
  const totalBytes = Object.values(files).reduce((total, file) => total + file.bytes, 0);
  let doneBytes = 0;

  const load = async (key: LoadedFile): Promise<Uint8Array<ArrayBuffer>> => {
    const { bytes: maxBytes, xxh3: expected } = files[key];
    const onBytes = (bytes: number) => {
      doneBytes += bytes;
      options.onProgress?.(doneBytes, totalBytes);
    };
    const address = versioned(`${url}/${key}`, manifest.version);
    const request = { token: options.token, signal };
    const bytes = await fetchBytes(address, request, { maxBytes, isExact: true, onBytes });
    if (xxh3(bytes) !== expected) {
      throw new StreamError("damaged", `${address} has another hash than the manifest says; load it again`, 200);
    }
    return bytes;
  };

  try {
    options.onProgress?.(0, totalBytes);
    const [glb, rows, regions, labels] = await Promise.all([
      load("base.glb"),
      load("base.cover"),
      load("regions.json"),
      fetchLabels(`${url}/labels.json`, { token: options.token, signal }),
    ]);
    // Right bytes may still hold a wrong file: base, cover and segment ids must belong together.
    const base = await decodeGlb(glb, -1, options.decodeImage);
    if (base.faceCount !== checked.baseFaces) {
      throw new PayloadError(`base of ${base.faceCount} faces, expected ${checked.baseFaces} by the manifest`);
    }
    const cover = decodeCover(rows, base.faceCount, manifest.segmentCount);
    const document = parseJson(regions, `${url}/regions.json`);
    return { manifest, base, cover, regions: readRegions(document, labels), unions: readUnions(document) };
  } catch (error) {
    abort.abort();
    if (!(error instanceof PayloadError)) throw error;
    const text = `scene ${manifest.id}, version ${manifest.version}: ${error.message}; it must be published anew`;
    throw new StreamError("damaged", text, undefined, { cause: error });
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
