/** One scene in several versions, and a service that serves them over a fake `fetch`. */

import { readFileSync } from "node:fs";
import type { FaceBits } from "../../src/core/types.ts";

const CORPUS = new URL("../../../../tests/conformance/scene/", import.meta.url);
/** The files that belong to one version, as clients name them. */
export const VERSIONED_FILES = ["base.tsg", "regions.json"] as const;

export const SCENE_URL = "http://server.test/scenes/quarry";

/** The files of one version by the name that a client asks for. */
type Files = ReadonlyMap<string, Uint8Array<ArrayBuffer>>;

/** A version's text: 32 digits. */
export function versionText(version: number): string {
  return version.toString(16).padStart(32, "0");
}

/**
 * Version of the scene: the corpus scene of odd and even versions differs, and its attribute begins at the version's number.
 */
export function filesOfVersion(version: number): Files {
  const folder = new URL(version % 2 === 1 ? "tiny/" : "tiny-textured/", CORPUS);
  const manifest = JSON.parse(readFileSync(new URL("scene.json", folder), "utf-8")) as {
    version: string;
    files: Record<string, { path: string; bytes: number }>;
    attributes: { offset: number }[];
  };
  const files = new Map<string, Uint8Array<ArrayBuffer>>();
  manifest.version = versionText(version);
  manifest.attributes[0]!.offset = version;
  for (const name of VERSIONED_FILES) {
    const row = manifest.files[name]!;
    files.set(name, Uint8Array.from(readFileSync(new URL(row.path, folder))));
  }
  return files.set("scene.json", new TextEncoder().encode(JSON.stringify(manifest)));
}

/** Base faces that these segments hide: in each version others. */
export function hiddenOf(version: number, shown: readonly number[], faces: number): FaceBits {
  const hidden = new Uint8Array(Math.ceil(faces / 8));
  for (let face = 0; face < faces; face += 1) {
    if (shown.includes((face + version) % 4)) hidden[face >> 3]! |= 1 << (face & 7);
  }
  return hidden;
}

/** Which version a file is answered of; null answers 404. `requested` is null for a request without `?v=`. */
export type Answering = (file: string, requested: string | null) => number | null;

/** A `fetch` of the scene's files. */
export function fetchOf(versions: ReadonlyMap<number, Files>, answering: Answering): typeof fetch {
  return async (input) => {
    const url = new URL(String(input));
    const file = url.href.startsWith(`${SCENE_URL}/`) ? url.pathname.slice(url.pathname.lastIndexOf("/") + 1) : "";
    const name = file === "" ? "scene.json" : file;
    const version = answering(name, url.searchParams.get("v"));
    const bytes = version === null ? undefined : versions.get(version)?.get(name);
    return bytes === undefined ? new Response("{}", { status: 404 }) : new Response(bytes);
  };
}
