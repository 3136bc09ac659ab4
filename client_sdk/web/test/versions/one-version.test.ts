/**
 * Base, hidden faces, regions and segments that are drawn together are of one version, in whatever order a
 * publication, a session and files come.
 *
 * Real loading, stage and stream watch; fake are `fetch`, the session and the graphics device.
 */

import { afterEach, beforeAll, beforeEach, describe, expect, it, vi } from "vitest";
import { type StreamListeners, watchStream } from "../../src/app/viewer/stream-watch.ts";
import { loadScene } from "../../src/core/scene/load.ts";
import type {
  AttributeScale,
  MeshData,
  SceneFiles,
  SegmentKey,
  Stream,
  StreamEvent,
  Vec3,
} from "../../src/core/types.ts";
import { Terrain } from "../../src/three/terrain.ts";
import { random as seeded } from "../random.ts";
import { drawnMeshes, FakeContext, fakeRenderer } from "./fake-gpu.ts";
import {
  type Answering,
  fetchOf,
  filesOfVersion,
  hiddenOf,
  SCENE_URL,
  VERSIONED_FILES,
  versionText,
} from "./published-scene.ts";

const VERSIONS = [1, 2, 3];
const ORIGIN: Vec3 = [0, 0, 0];

const served = new Map<number, ReturnType<typeof filesOfVersion>>();
/** The scene of each version, loaded while it alone was served. */
const references = new Map<number, SceneFiles>();

beforeAll(async () => {
  for (const version of VERSIONS) served.set(version, filesOfVersion(version));
  for (const version of VERSIONS) {
    serve(() => version);
    references.set(version, await loadScene(SCENE_URL));
  }
});

beforeEach(() => {
  vi.stubGlobal("WebGL2RenderingContext", FakeContext);
  serve(
    (_file, requested) => VERSIONS.find((version) => requested === null || versionText(version) === requested) ?? null,
  );
});

afterEach(() => vi.unstubAllGlobals());

describe("a load across a publication", () => {
  it.each(VERSIONED_FILES)("starts over where %s is of the newer version", async (crossing) => {
    let newest = 1;
    serve((file) => {
      // Published after the manifest was read; the files pass through a cache that knows no versions.
      if (file === crossing) newest = 2;
      return newest;
    });
    expectVersion(await loadScene(SCENE_URL), 2);
  });

  it.each(VERSIONED_FILES)("fails where %s is still of the older version", async (stale) => {
    serve((file) => (file === stale ? 1 : 2));
    await expect(loadScene(SCENE_URL)).rejects.toMatchObject({ code: "damaged" });
  });

  it.each(VERSIONED_FILES)("starts over where %s of the older version is withdrawn", async (withdrawn) => {
    let newest = 1;
    serve((file, requested) => {
      if (file === withdrawn) newest = 2;
      return requested === null || requested === versionText(newest) ? newest : null;
    });
    expectVersion(await loadScene(SCENE_URL), 2);
  });

  it.each(VERSIONED_FILES)("gives up where a version was asked for, and %s is of another", async (crossing) => {
    serve((file) => (file === crossing ? 2 : 1));
    await expect(loadScene(SCENE_URL, { version: versionText(1) })).rejects.toMatchObject({ code: "damaged" });
  });
});

describe("a session of another version than the files", () => {
  it("shows none of its segments before its own files are there", async () => {
    const page = new Page(1);
    page.open(2, false);
    page.land([0, 1]);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 1, segments: [] });
    expect(page.stage.status.phase).not.toBe("presentable");
    await page.deliver(2);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 2, segments: [0, 1] });
  });

  it("loads them at once, by their version, where no headset is worn", async () => {
    const page = new Page(1, false);
    page.open(2, false);
    page.land([0, 1]);
    await page.frames(12);
    expect(page.reloads).toEqual([versionText(2)]);
    expect(page.drawn()).toEqual({ version: 1, segments: [] });
  });

  it("keeps what is shown of the old version until then", async () => {
    const page = new Page(1);
    page.open(1, false);
    page.land([0, 1]);
    await page.frames(12);
    page.open(2, true);
    page.land([2, 3]);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 1, segments: [0, 1] });
    await page.deliver(2);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 2, segments: [2, 3] });
  });

  it("takes no files of a version that the session has left", async () => {
    const page = new Page(1);
    page.open(2, false);
    page.open(3, true);
    page.land([1, 2]);
    await page.deliver(2);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 1, segments: [] });
    expect(page.stage.neededVersion).toBe(versionText(3));
    await page.deliver(3);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 3, segments: [1, 2] });
  });

  it("changes nothing where its own files come a second time", async () => {
    const page = new Page(1);
    page.open(1, false);
    // To another replica and back, twice: version 1 is asked for twice.
    for (const version of [2, 1, 2, 1]) page.open(version, true);
    await page.deliver(1);
    page.land([0, 1]);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 1, segments: [0, 1] });
    await page.deliver(1);
    await page.frames(2);
    expect(page.drawn()).toEqual({ version: 1, segments: [0, 1] });
  });

  it("takes no files that are the old ones once more", async () => {
    const page = new Page(1);
    page.open(2, false);
    page.land([0, 3]);
    page.stage.replaceFiles(references.get(1)!);
    await page.frames(12);
    expect(page.drawn()).toEqual({ version: 1, segments: [] });
    expect(page.stage.neededVersion).toBe(versionText(2));
  });
});

it.each(Array.from({ length: 60 }, (_, seed) => seed))("no order shows a mix (seed %i)", async (seed) => {
  const random = seeded(seed);
  const pick = <Item>(items: readonly Item[]): Item => items[Math.floor(random() * items.length)]!;
  const page = new Page(pick(VERSIONS), true, true);
  page.open(pick(VERSIONS), false);
  for (let step = 0; step < 100; step += 1) {
    const chance = random();
    if (chance < 0.1) page.open(pick(VERSIONS), true);
    else if (chance < 0.22) page.land([0, 1, 2, 3].filter(() => random() < 0.5));
    else if (chance < 0.37 && page.pending.length > 0) await page.deliver(pick(page.pending));
    else if (chance < 0.6 && page.meshes.length > 0)
      page.meshes.splice(Math.floor(random() * page.meshes.length), 1)[0]!();
    else await page.frames(1);
  }
  // And nothing stays behind.
  while (page.pending.length > 0 || page.meshes.length > 0) {
    for (const decoded of page.meshes.splice(0)) decoded();
    if (page.pending.length > 0) await page.deliver(page.pending[0]!);
    await page.frames(4);
  }
  page.land([0, 1, 2, 3]);
  for (let frame = 0; frame < 20; frame += 1) {
    for (const decoded of page.meshes.splice(0)) decoded();
    await page.frames(1);
  }
  expect(page.drawn()).toEqual({ version: page.session, segments: [0, 1, 2, 3] });
});

/** A page that shows the scene: every frame is compared with all versions. */
class Page {
  readonly stage: Terrain;
  /** Version of the session. */
  session = 0;
  /** Versions whose files are on their way. */
  readonly pending: number[] = [];
  /** Decoded segments that are on their way, where they are held up. */
  readonly meshes: (() => void)[] = [];
  readonly reloads: (string | undefined)[] = [];
  readonly #deliveries: { readonly version: number; readonly arrive: () => Promise<void> }[] = [];
  readonly #stream: Stream;
  readonly #handle: (event: StreamEvent) => void;
  #landing = 0;

  constructor(version: number, headset = true, holdsMeshes = false) {
    this.#stream = {
      land: () => {
        this.#landing += 1;
        return this.#landing;
      },
      mesh: (key: SegmentKey, attributes: readonly AttributeScale[]) => {
        // A payload has an attribute's codes; what they mean is the version's.
        expect(attributes.map(({ offset }) => offset)).toEqual([this.session]);
        const mesh = segmentMesh(this.session, Number(key));
        if (!holdsMeshes) return Promise.resolve(mesh);
        return new Promise<MeshData>((resolve) => this.meshes.push(() => resolve(mesh)));
      },
      stats: () => new Promise(() => undefined),
    } as unknown as Stream;
    const files = references.get(version)!;
    this.stage = new Terrain({ renderer: fakeRenderer(), stream: this.#stream, files, uploadBudgetMs: 1e6 });
    const state = { maxRadiusM: 100, radiusM: 10 };
    this.#handle = watchStream({
      stage: this.stage,
      stream: this.#stream,
      store: { get: () => state, set: () => undefined },
      desk: { handle: () => undefined },
      headset: { session: headset ? {} : null, handle: () => undefined },
      comfort: { restart: () => undefined },
      notices: { show: () => undefined, clear: () => undefined },
      listeners: { emit: () => undefined },
      loop: { request: () => undefined },
      reload: (needed?: string) => this.reloads.push(needed),
      loadFiles: (needed: string) => this.#load(needed),
    } as unknown as StreamListeners);
  }

  /** A session of that version opens. */
  open(version: number, changed: boolean): void {
    const isOther = changed && version !== this.session;
    this.session = version;
    this.#handle({
      type: "opened",
      sceneVersion: versionText(version),
      session: "session",
      changed: isOther,
      maxRadiusM: 100,
    });
  }

  /** A landing of the session's version, planned and ready at once. */
  land(segments: readonly number[]): void {
    void this.stage.land(ORIGIN, 10);
    const { landing } = this.stage.status;
    const show = segments.map((segment) => ({
      key: String(segment),
      segment,
      isCoarser: false,
      bytes: 1,
      faces: 1,
      vertices: 3,
      follows: true,
    }));
    const hidden = hiddenOf(this.session, segments, references.get(this.session)!.base.faceCount);
    this.#handle({
      type: "planned",
      plan: {
        landing,
        position: ORIGIN,
        radiusM: 10,
        effectiveRadiusM: 10,
        coarseRadiusM: null,
        show,
        hidden,
        loadBytes: segments.length,
        totalBytes: segments.length,
        totalTriangles: segments.length,
        omittedSegments: 0,
        omittedBy: null,
      },
    });
    const bounds = [0, 0, 0, 1, 1, 1] as const;
    for (const { key } of show) this.#handle({ type: "arrived", landing, key, bytes: 1, bounds });
    const counts = { elapsedMs: 1, readyAtMs: 1, payloadBytes: segments.length };
    this.#handle({ type: "ready", landing, visible: show.map(({ key }) => key), hidden, missing: [], ...counts });
  }

  /** The files that were asked for. */
  async deliver(version: number): Promise<void> {
    this.pending.splice(this.pending.indexOf(version), 1);
    const index = this.#deliveries.findIndex((delivery) => delivery.version === version);
    await this.#deliveries.splice(index, 1)[0]!.arrive();
  }

  async frames(count: number): Promise<void> {
    for (let frame = 0; frame < count; frame += 1) {
      this.stage.update();
      this.stage.swap();
      this.drawn();
      await new Promise(setImmediate);
    }
  }

  /** The version that is drawn, and its segments; throws where what is drawn is no picture of any version. */
  drawn(): { version: number; segments: number[] } | null {
    const meshes = drawnMeshes(this.stage);
    const base = meshes.find(({ name }) => name === "base");
    const details = meshes
      .filter((mesh) => mesh !== base)
      .map(({ positions }) => [positions[0]!, positions[1]!] as const);
    const segments = details.map(([, segment]) => segment).sort();
    // The base's own upload: nothing at all is drawn then.
    if (base === undefined && segments.length === 0) return null;
    const candidates = [this.stage.neededVersion === null ? this.session : 0, ...VERSIONS];
    for (const version of candidates) {
      const reference = references.get(version);
      if (reference === undefined || base === undefined || details.some(([of]) => of !== version)) continue;
      const { positions, colours } = reference.base;
      const isBase = base.attributes.includes("tint") === (colours !== null) && sameValues(base.positions, positions);
      if (isBase && sameValues(base.faces, visibleFaces(version, segments))) return { version, segments };
    }
    const drawn = `base ${base?.attributes}, faces ${base?.faces}, segments ${details.map((pair) => pair.join(":"))}`;
    throw new Error(`a mix of versions is drawn: ${drawn}`);
  }

  #load(needed: string): Promise<SceneFiles> {
    const version = VERSIONS.find((candidate) => versionText(candidate) === needed)!;
    this.pending.push(version);
    return new Promise((resolve) => {
      const arrive = async (): Promise<void> => {
        resolve(await loadScene(SCENE_URL, { version: needed }));
        await new Promise(setImmediate);
      };
      this.#deliveries.push({ version, arrive });
    });
  }
}

/** One triangle whose first position says what it is. */
function segmentMesh(version: number, segment: number): MeshData {
  return {
    vertexCount: 3,
    faceCount: 1,
    translation: ORIGIN,
    stepM: 1,
    positions: Uint16Array.of(version, segment, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0),
    normals: new Int8Array(12),
    colours: new Uint16Array(12),
    uvs: null,
    uvScale: [1, 1],
    regionIds: null,
    attributes: [],
    indices: Uint16Array.of(0, 1, 2),
    image: null,
    bounds: [0, 0, 0, 1, 1, 1],
  };
}

/** Faces of the base that are not hidden under these. */
function visibleFaces(version: number, shown: readonly number[]): number[] {
  const faces = Array.from({ length: references.get(version)!.base.faceCount }, (_, face) => face);
  return faces.filter((face) => !shown.includes((face + version) % 4));
}

function expectVersion(files: SceneFiles, version: number): void {
  const { base, regions } = references.get(version)!;
  expect(files.manifest.version).toBe(versionText(version));
  expect(files.base).toEqual(base);
  expect(files.regions).toEqual(regions);
}

function sameValues(a: ArrayLike<number>, b: ArrayLike<number>): boolean {
  return a.length === b.length && Array.from(a).every((value, index) => value === b[index]);
}

function serve(answering: Answering): void {
  vi.stubGlobal("fetch", fetchOf(served, answering));
}
