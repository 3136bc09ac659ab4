/** Scenes over HTTP: the corpus scenes (tests/conformance/scene), whole and damaged, served by Node. */

import { readFileSync } from "node:fs";
import type { IncomingMessage, Server, ServerResponse } from "node:http";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { readImageHeader } from "../src/core/payload/image-header.ts";
import { StreamError } from "../src/core/scene/errors.ts";
import type { LoadOptions } from "../src/core/scene/load.ts";
import { listScenes, loadScene } from "../src/core/scene/load.ts";
import type { SceneFiles } from "../src/core/types.ts";

const CORPUS = new URL("../../../tests/conformance/scene/", import.meta.url);

/** One change to one file, as tests/conformance/scene/README.md describes it. */
interface Edit {
  readonly flip?: number;
  readonly truncate?: number;
  readonly write?: [number, string];
  readonly delete?: true;
  readonly set?: [(string | number)[], unknown];
}

interface Damage {
  readonly name: string;
  readonly scene?: string;
  readonly file: string;
  readonly edit: Edit;
}

/** What a client makes of each case; it reads neither pack nor index, and no paths. */
const DAMAGE = JSON.parse(readFileSync(new URL("damaged.json", CORPUS), "utf-8")) as Damage[];
const REFUSED: ReadonlyMap<string, string> = new Map([
  ["flipped base byte", "damaged"],
  ["base cut short", "damaged"],
  ["regions are no JSON", "damaged"],
  ["manifest of another format", "damaged"],
  ["manifest of the next major version", "unsupported_version"],
  ["manifest cut short", "damaged"],
]);
const READ_BY_CLIENTS = new Set(["scene.json", "base.tsg", "regions.json", "labels.json"]);

type Files = Map<string, Buffer>;
/** Answers before the files do; false to let them. */
type Gate = (request: IncomingMessage, response: ServerResponse) => boolean;

let server: Server;
let url: string;
let scenes: Map<string, Files>;
let gate: Gate;
let requests: string[];

beforeEach(async () => {
  scenes = new Map();
  requests = [];
  gate = () => false;
  server = createServer((request, response) => {
    requests.push(`${request.url} ${request.headers.authorization ?? ""}`.trim());
    if (!gate(request, response)) answer(request, response);
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  url = `http://127.0.0.1:${(server.address() as AddressInfo).port}`;
});

afterEach(() => {
  server.closeAllConnections();
  server.close();
});

describe("a whole scene", () => {
  it.each(["tiny", "tiny-textured", "tiny-base-image", "tiny-changed"])("%s is loaded", async (name) => {
    scenes.set(name, filesOf(name));
    const progress: [number, number][] = [];
    const onProgress = (doneBytes: number, totalBytes: number) => progress.push([doneBytes, totalBytes]);
    const { manifest, base, regions } = await loadScene(`${url}/scenes/${name}`, { onProgress });
    expect(manifest).toMatchObject({ id: name, segmentCount: 4, detailFaces: 288, origin: [500000, 8000000, 100] });
    expect(manifest.stepM).toBe(2 ** -12);
    expect(base.faceCount).toBe(32);
    expect(base.bounds.every(Number.isFinite)).toBe(true);
    expect(regions.map((region) => region.id)).toEqual([0, 1, 2]);
    expect(progress[0]![0]).toBe(0);
    expect(progress.at(-1)![0]).toBe(progress.at(-1)![1]);
    expect(requests.some((line) => line.includes("Bearer"))).toBe(false);
  });

  it("has labels by stable id", async () => {
    scenes.set("tiny", filesOf("tiny"));
    const { regions } = await loadScene(`${url}/scenes/tiny`);
    expect(regions.map((region) => region.stableId)).toEqual([5, 2, 9]);
    expect(regions.map((region) => region.label)).toEqual([null, "bench", "haul road"]);
  });

  it("has textures where it says so", async () => {
    scenes.set("tiny", filesOf("tiny-textured"));
    const decodedFiles: string[] = [];
    const decodeImage: LoadOptions["decodeImage"] = async (bytes, mediaType) => {
      decodedFiles.push(`${mediaType} ${bytes.length}`);
      const { width, height } = readImageHeader(bytes);
      return { width, height, close: () => undefined };
    };
    const { manifest, base } = await loadScene(`${url}/scenes/tiny`, { decodeImage });
    expect(manifest.texturesOf).toBe("photos");
    expect(decodedFiles).toHaveLength(1);
    expect(base.image).toMatchObject({ mediaType: "image/jpeg", width: 16, height: 8 });
    expect(base.colours).toBeNull();

    const wrongSize: LoadOptions["decodeImage"] = async () => ({ width: 64, height: 32, close: () => undefined });
    await expect(loadScene(`${url}/scenes/tiny`, { decodeImage: wrongSize })).rejects.toMatchObject({
      code: "damaged",
    });
  });

  it("is the only one of a server URL, behind a prefix", async () => {
    scenes.set("tiny", filesOf("tiny"));
    const { manifest } = await loadScene(`ws${url.slice(4)}/prefix`);
    expect(manifest.id).toBe("tiny");
    scenes.set("other", filesOf("tiny"));
    await expect(loadScene(url)).rejects.toMatchObject({ code: "several_scenes" });
  });

  it("has a texture of the base alone beside segments with colours", async () => {
    scenes.set("tiny", filesOf("tiny-base-image"));
    const { manifest, base } = await loadScene(`${url}/scenes/tiny`, {
      decodeImage: async () => ({ width: 16, height: 8, close: () => undefined }),
    });
    expect(manifest).toMatchObject({ texturesOf: "points", hasColour: true });
    expect(base.image).toMatchObject({ mediaType: "image/jpeg", width: 16, height: 8 });
    expect(base.colours).toBeNull();
  });

  it("is loaded anew where it is published meanwhile", async () => {
    scenes.set("tiny", filesOf("tiny-textured"));
    let served = 0;
    gate = () => {
      served += 1;
      // The manifest is out; now the newer version stands, and the older one is gone.
      if (served === 2) scenes.set("tiny", filesOf("tiny"));
      return false;
    };
    const { regions } = await loadScene(`${url}/scenes/tiny`);
    expect(regions.map((region) => region.stableId)).toEqual([5, 2, 9]);
  });
});

describe("a scene with an overview", () => {
  /** The scene `tiny`, and these bytes as its overview. */
  async function servedWith(overview: Buffer): Promise<void> {
    const files = filesOf("tiny");
    const manifest = JSON.parse(files.get("scene.json")!.toString()) as { files: Record<string, unknown> };
    manifest.files["overview.tsg"] = { path: "v/overview.tsg", bytes: overview.length };
    files.set("scene.json", Buffer.from(JSON.stringify(manifest))).set("overview.tsg", overview);
    scenes.set("tiny", files);
  }
  const asked = () => requests.map((line) => line.replace(/.*tiny\/?([^?]*).*/, "$1"));

  it("gives it before the base is asked for, to be hidden by nothing", async () => {
    await servedWith(filesOf("tiny").get("base.tsg")!);
    const seen: [SceneFiles, string[]][] = [];
    const files = await loadScene(`${url}/scenes/tiny`, { onOverview: (first) => seen.push([first, asked()]) });
    expect(seen).toHaveLength(1);
    const [first, before] = seen[0]!;
    expect(before).toContain("overview.tsg");
    expect(before).not.toContain("base.tsg");
    expect(first).toMatchObject({ isOverview: true, manifest: files.manifest, regions: files.regions });
    expect(files.isOverview).toBeUndefined();
  });

  it("does not fetch it for who shows none", async () => {
    await servedWith(filesOf("tiny").get("base.tsg")!);
    await loadScene(`${url}/scenes/tiny`);
    expect(asked()).not.toContain("overview.tsg");
  });

  it("goes on without one that is damaged, or gone", async () => {
    await servedWith(Buffer.from("no mesh"));
    const onOverview = vi.fn();
    expect((await loadScene(`${url}/scenes/tiny`, { onOverview })).base.faceCount).toBe(32);
    scenes.get("tiny")!.delete("overview.tsg");
    expect((await loadScene(`${url}/scenes/tiny`, { onOverview })).base.faceCount).toBe(32);
    expect(onOverview).not.toHaveBeenCalled();
  });
});

describe("a damaged scene", () => {
  it.each(DAMAGE.filter((damage) => READ_BY_CLIENTS.has(damage.file)))("$name", async (damage) => {
    scenes.set("tiny", filesOf(damage.scene ?? "tiny", damage));
    const loading = loadScene(`${url}/scenes/tiny`);
    const code = REFUSED.get(damage.name);
    if (code !== undefined) {
      await expect(loading).rejects.toMatchObject({ name: "StreamError", code });
      return;
    }
    const { regions } = await loading;
    // Damaged labels never take the ground away; only the build's own remain.
    if (damage.file === "labels.json") expect(regions.map((region) => region.label)).toEqual([null, "bench", null]);
  });

  it.each<[(string | number)[], unknown, string]>([
    [["attributes", 0, "step"], 0, 'scale of attribute "grade"'],
    [["attributes", 0, "step"], 1e36, 'scale of attribute "grade"'],
    [["attributes", 0, "offset"], null, 'offset of attribute "grade"'],
    [["encodings"], { glb: {} }, "encodings.segment-2 is missing"],
  ])("whose segments cannot be decoded: %j %j", async (key, value, text) => {
    scenes.set("tiny", filesOf("tiny", { name: text, file: "scene.json", edit: { set: [key, value] } }));
    await expect(loadScene(`${url}/scenes/tiny`)).rejects.toMatchObject({
      code: "damaged",
      message: expect.stringContaining(text),
    });
  });

  it("every refusal is one of the corpus", () => {
    const names = DAMAGE.map((damage) => damage.name);
    for (const name of REFUSED.keys()) expect(names).toContain(name);
  });
});

describe("a server that refuses", () => {
  it.each([
    [401, "unauthorised"],
    [403, "forbidden"],
    [404, "unknown_scene"],
    [503, "draining"],
    [418, "refused"],
  ])("%i is %s, also from a proxy", async (status, code) => {
    gate = (_request, response) => {
      response.writeHead(status, { "content-type": "text/html" }).end("<h1>no</h1>");
      return true;
    };
    await expect(loadScene(`${url}/scenes/tiny`)).rejects.toMatchObject({ code, status });
    await expect(listScenes(url)).rejects.toMatchObject({ code, status });
  });

  it("is quoted", async () => {
    gate = (_request, response) => {
      response.writeHead(404).end('{"error":{"code":"unknown_scene","message":"no scene here"}}');
      return true;
    };
    await expect(listScenes(url)).rejects.toThrow("no scene here");
  });

  it("sees the token, and nobody else does", async () => {
    scenes.set("tiny", filesOf("tiny"));
    await loadScene(`${url}/scenes/tiny`, { token: "secret" });
    expect(requests.length).toBeGreaterThanOrEqual(4);
    for (const line of requests) expect(line).toMatch(/^[^ ]+ Bearer secret$/);
    // To a place that would answer.
    gate = (request, response) => {
      if (request.url!.startsWith("/prefix")) return false;
      response.writeHead(302, { location: `${url}/prefix${request.url}` }).end();
      return true;
    };
    await expect(loadScene(`${url}/scenes/tiny`, { token: "secret" })).rejects.toMatchObject({ code: "unreachable" });
  });

  it("does not answer at all", async () => {
    server.close();
    server.closeAllConnections();
    await expect(listScenes(url)).rejects.toMatchObject({ code: "unreachable" });
  });
});

it("stops where it is aborted", async () => {
  scenes.set("tiny", filesOf("tiny"));
  const abort = new AbortController();
  gate = (request) => request.url!.includes("base.tsg"); // never answered
  const loading = loadScene(`${url}/scenes/tiny`, { signal: abort.signal });
  setTimeout(() => abort.abort(new Error("enough")), 50);
  await expect(loading).rejects.toThrow("enough");
});

it("stops the other files where one fails", async () => {
  scenes.set("tiny", filesOf("tiny"));
  let isClosed = false;
  gate = (request, response) => {
    if (request.url!.includes("regions.json")) response.writeHead(500).end();
    else if (!request.url!.includes("base.tsg")) return false;
    // base.tsg: never answered; the client lets go of it.
    else response.on("close", () => (isClosed = true));
    return true;
  };
  await expect(loadScene(`${url}/scenes/tiny`)).rejects.toMatchObject({ status: 500 });
  await vi.waitFor(() => expect(isClosed).toBe(true));
});

it("reads no more than the manifest says", async () => {
  scenes.set("tiny", filesOf("tiny"));
  gate = (request, response) => {
    if (!request.url!.includes("base.tsg")) return false;
    const pour = () => {
      while (!response.destroyed && response.write(Buffer.alloc(65_536)));
    };
    response.on("drain", pour);
    pour();
    return true;
  };
  await expect(loadScene(`${url}/scenes/tiny`)).rejects.toMatchObject({ code: "damaged" });
});

it("lists scenes with their pages", async () => {
  scenes.set("a b", filesOf("tiny"));
  expect(await listScenes(`${url}/prefix/scenes/a%20b`)).toEqual({
    scenes: [
      {
        id: "a b",
        name: "tiny 0",
        version: expect.stringMatching(/^[0-9a-f]{32}$/),
        segments: 4,
        detailFaces: 288,
        reportUrl: `${url}/prefix/scenes/a%20b/report`,
        reportPdfUrl: "",
        previewUrl: "",
      },
    ],
    building: [
      { id: "pit", name: "The pit", step: "read", share: 0.5 },
      { id: "b", name: "b", step: "pack", share: null },
    ],
    links: { docs: `${url}/prefix/docs` },
  });
});

function filesOf(scene: string, damage?: Damage): Files {
  const folder = new URL(`${scene}/`, CORPUS);
  const manifest = readFileSync(new URL("scene.json", folder));
  const paths = (JSON.parse(manifest.toString()) as { files: Record<string, { path: string }> }).files;
  const files: Files = new Map([["scene.json", manifest]]);
  for (const name of ["base.tsg", "regions.json"]) {
    files.set(name, readFileSync(new URL(paths[name]!.path, folder)));
  }
  if (scene === "tiny") files.set("labels.json", readFileSync(new URL("labels.json", folder)));
  if (damage === undefined) return files;
  const edited = apply(damage.edit, files.get(damage.file)!);
  if (edited === null) files.delete(damage.file);
  else files.set(damage.file, edited);
  return files;
}

function apply(edit: Edit, original: Buffer): Buffer | null {
  const data = Buffer.from(original);
  if (edit.delete === true) return null;
  if (edit.truncate !== undefined) return data.subarray(0, edit.truncate);
  if (edit.flip !== undefined) data[edit.flip]! ^= 1;
  if (edit.write !== undefined) Buffer.from(edit.write[1], "hex").copy(data, edit.write[0]);
  if (edit.set === undefined) return data;
  const [keys, value] = edit.set;
  const document = JSON.parse(data.toString()) as Record<string | number, unknown>;
  let node = document;
  for (const key of keys.slice(0, -1)) node = node[key] as typeof document;
  node[keys.at(-1)!] = value;
  return Buffer.from(JSON.stringify(document));
}

/** As our server does: by version, 404 for one that it does not have. */
function answer(request: IncomingMessage, response: ServerResponse): void {
  const { pathname, searchParams } = new URL(request.url!, url);
  const path = pathname.replace("/prefix", "").split("/").slice(2).map(decodeURIComponent);
  if (path.length === 0) {
    const lines = [...scenes].map(([id, files]) => lineOf(id, files));
    const building = [
      { id: "pit", name: "The pit", step: "read", share: 0.5 },
      { id: "b", step: "pack" },
      { id: 3 },
      null,
    ];
    response.end(JSON.stringify({ scenes: lines, building, links: { docs: "docs" } }));
    return;
  }
  const files = scenes.get(path[0]!);
  const data = files?.get(path[1] ?? "scene.json");
  const requestedVersion = searchParams.get("v");
  const servedVersion =
    files === undefined ? null : /"version": ?"([0-9a-f]{32})"/.exec(files.get("scene.json")!.toString())?.[1];
  if (data === undefined || (requestedVersion !== null && requestedVersion !== servedVersion)) {
    response.writeHead(404).end('{"error":{"code":"unknown_scene","message":"not here"}}');
    return;
  }
  response.end(data);
}

function lineOf(id: string, files: Files): unknown {
  const { name, version, counts } = JSON.parse(files.get("scene.json")!.toString()) as {
    name: string;
    version: string;
    counts: { segments: number; detail_faces: number };
  };
  const links = { report: `scenes/${id}/report` };
  return { id, name, version, segments: counts.segments, detail_faces: counts.detail_faces, links };
}

it("StreamError says what it is", () => {
  expect(new StreamError("forbidden", "no", 403)).toMatchObject({
    name: "StreamError",
    code: "forbidden",
    status: 403,
  });
});
