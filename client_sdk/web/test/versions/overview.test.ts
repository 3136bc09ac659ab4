/** A stage that begins with the overview: ground is drawn throughout, once, and no segment before the base is here. */

import { afterEach, beforeAll, beforeEach, expect, it, vi } from "vitest";
import { loadScene } from "../../src/core/scene/load.ts";
import type { MeshData, SceneFiles, Stream } from "../../src/core/types.ts";
import { Terrain } from "../../src/three/terrain.ts";
import { drawnMeshes, FakeContext, fakeRenderer } from "./fake-gpu.ts";
import { fetchOf, filesOfVersion, SCENE_URL, versionText } from "./published-scene.ts";

const OVERVIEW_FACES = 10;

let files: SceneFiles;

beforeAll(async () => {
  vi.stubGlobal(
    "fetch",
    fetchOf(new Map([[1, filesOfVersion(1)]]), () => 1),
  );
  files = await loadScene(SCENE_URL);
});
beforeEach(() => vi.stubGlobal("WebGL2RenderingContext", FakeContext));
afterEach(() => vi.unstubAllGlobals());

function overviewOf(whole: SceneFiles): SceneFiles {
  const base = {
    ...whole.base,
    faceCount: OVERVIEW_FACES,
    indices: whole.base.indices.slice(0, OVERVIEW_FACES * 3),
  };
  return { ...whole, base, isOverview: true };
}

function begun(first: SceneFiles): Terrain {
  const mesh: MeshData = { ...files.base, image: null };
  const stream = { land: () => 1, aim: () => undefined, mesh: async () => mesh };
  const stage = new Terrain({ renderer: fakeRenderer(), stream: stream as unknown as Stream, files: first });
  stage.handle({
    type: "opened",
    sceneVersion: versionText(1),
    session: "session",
    changed: false,
    maxRadiusM: 100,
  });
  return stage;
}

/** Faces of the base meshes that the frame draws, and the segments. */
async function frame(stage: Terrain): Promise<{ bases: number[]; segments: number }> {
  stage.update();
  stage.swap();
  await new Promise(setImmediate);
  const meshes = drawnMeshes(stage);
  const bases = meshes.filter(({ name }) => name === "base").map(({ faces }) => faces.length);
  return { bases, segments: meshes.length - bases.length };
}

function landAtAll(stage: Terrain): void {
  void stage.land([0, 0, 0], 10);
  const { landing } = stage.status;
  const show = Array.from({ length: files.manifest.segmentCount }, (_, segment) => ({
    key: String(segment),
    segment,
    isCoarser: false,
    bytes: 1,
    faces: 1,
    vertices: 3,
    follows: true,
  }));
  const hidden = new Uint8Array(Math.ceil(files.base.faceCount / 8)).fill(255);
  stage.handle({
    type: "planned",
    plan: {
      landing,
      position: [0, 0, 0],
      radiusM: 10,
      effectiveRadiusM: 10,
      coarseRadiusM: null,
      show,
      hidden,
      loadBytes: 4,
      totalBytes: 4,
      totalTriangles: 4,
      omittedSegments: 0,
      omittedBy: null,
    },
  });
  const bounds = [0, 0, 0, 1, 1, 1] as const;
  for (const { key } of show) stage.handle({ type: "arrived", landing, key, bytes: 1, bounds });
  const visible = show.map(({ key }) => key);
  stage.handle({ type: "ready", landing, visible, hidden, missing: [], elapsedMs: 1, readyAtMs: 1, payloadBytes: 4 });
}

it("draws the overview, then the base in its place, and only then a landing", async () => {
  const stage = begun(overviewOf(files));
  landAtAll(stage);
  for (let count = 0; count < 12; count += 1) await frame(stage);
  expect(await frame(stage)).toEqual({ bases: [OVERVIEW_FACES], segments: 0 });
  expect(stage.status.phase).not.toBe("presentable");
  expect(stage.neededVersion).toBeNull();

  stage.replaceFiles(files);
  const seen = [];
  for (let count = 0; count < 400 && seen.at(-1)?.segments !== 4; count += 1) {
    // At first nothing is uploaded.
    stage.uploadBudgetMs = count < 5 ? 0 : 1e6;
    seen.push(await frame(stage));
  }
  expect(seen[0]).toEqual({ bases: [OVERVIEW_FACES], segments: 0 });
  // Never none, never two.
  for (const { bases } of seen) expect(bases).toHaveLength(1);
  expect(seen.at(-1)).toEqual({ bases: [0], segments: 4 });
});

it("takes no files of another version in its place", async () => {
  const stage = begun(overviewOf(files));
  stage.replaceFiles({ ...files, manifest: { ...files.manifest, version: versionText(2) } });
  for (let count = 0; count < 12; count += 1) await frame(stage);
  expect((await frame(stage)).bases).toEqual([OVERVIEW_FACES]);
});
