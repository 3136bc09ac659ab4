/** One scene in several versions, and a service that serves them over a fake `fetch`. */

import { readFileSync } from "node:fs";
import { decodeCover } from "../../src/core/payload/cover.ts";
import { xxh3 } from "../../src/core/payload/hash.ts";
import { coverBytes } from "../cover-bytes.ts";

const CORPUS = new URL("../../../../tests/conformance/scene/", import.meta.url);
/** The files that belong to one version, as clients name them. */
export const VERSIONED_FILES = ["base.glb", "base.cover", "regions.json"] as const;

export const SCENE_URL = "http://server.test/scenes/quarry";

/** The files of one version by the name that a client asks for. */
type Files = ReadonlyMap<string, Uint8Array<ArrayBuffer>>;

/** A version's text: 32 digits. */
export function versionText(version: number): string {
  return version.toString(16).padStart(32, "0");
}

/**
 * Version of the scene: the corpus scene of odd and even versions differs, and in each version other segments lie over a base
 * face, and its attribute begins at the version's number. Needs `prepareHash`.
 */
export function filesOfVersion(version: number): Files {
  const folder = new URL(version % 2 === 1 ? "tiny/" : "tiny-textured/", CORPUS);
  const manifest = JSON.parse(readFileSync(new URL("scene.json", folder), "utf-8")) as {
    version: string;
    counts: { base_faces: number; segments: number };
    files: Record<string, { path: string; bytes: number; xxh3: string }>;
    attributes: { offset: number }[];
  };
  const files = new Map<string, Uint8Array<ArrayBuffer>>();
  manifest.version = versionText(version);
  manifest.attributes[0]!.offset = version;
  for (const name of VERSIONED_FILES) {
    const row = manifest.files[name]!;
    let bytes = Uint8Array.from(readFileSync(new URL(row.path, folder)));
    if (name === "base.cover") bytes = withShiftedIds(bytes, version, manifest.counts);
    row.bytes = bytes.length;
    row.xxh3 = xxh3(bytes).toString(16).padStart(16, "0");
    files.set(name, bytes);
  }
  return files.set("scene.json", new TextEncoder().encode(JSON.stringify(manifest)));
}

function withShiftedIds(
  cover: Uint8Array<ArrayBuffer>,
  shift: number,
  counts: { readonly base_faces: number; readonly segments: number },
): Uint8Array<ArrayBuffer> {
  const { offsets, segments } = decodeCover(cover, counts.base_faces, counts.segments);
  const shifted = segments.map((segment) => (segment + shift) % counts.segments);
  return coverBytes(
    Array.from({ length: counts.base_faces }, (_, face) => [...shifted.slice(offsets[face], offsets[face + 1]).sort()]),
  );
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
