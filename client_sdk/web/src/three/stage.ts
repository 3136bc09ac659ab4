/**
 * The drawn scene: base mesh, segments of the newest landing, and the swap between two landings.
 *
 * What is visible changes in {@link Stage.swap} alone, which sets flags: buffers, textures and the base's next list of faces
 * were uploaded before, a few milliseconds in each frame's `update`. (core/residency.ts says what is uploaded and when.)
 */

import { type Camera, Group, type WebGLRenderer } from "three";

import { mix32 } from "../core/cover.ts";
import { Residency } from "../core/residency.ts";
import type {
  Bounds,
  LandOptions,
  MeshData,
  SceneFiles,
  Stream,
  StreamEvent,
  StreamStats,
  Vec3,
} from "../core/types.ts";
import { BaseGround } from "./base-ground.ts";
import { FaceBoxes } from "./face-boxes.ts";
import { FrameTimes } from "./frame-times.ts";
import { GpuStore } from "./gpu-store.ts";
import { GroundMaterial } from "./ground-material.ts";
import { castGround, groundOnVertical, type Pickable, type ShownGround } from "./ground-picking.ts";
import { statusOf } from "./landing-status.ts";
import { gpuBytesOf } from "./mesh-upload.ts";
import { regionColour, segmentColour, toCss } from "./palette.ts";
import { SegmentGround } from "./segment-ground.ts";
import type { GroundHit, LandingStatus, Landings, StageStats, SwapReport, ViewMode, VisibleDigest } from "./types.ts";

/** Light or dark page: decides the grey of "no value" alone. */
export type Theme = "light" | "dark";

/** What a stage is made of. */
export interface StageOptions {
  readonly renderer: WebGLRenderer;
  readonly stream: Stream;
  readonly files: SceneFiles;
  /** Bytes on the GPU of segments that nothing shows or waits for (prefetched by an aim). Default 128 MiB. */
  readonly gpuBytes?: number;
  /** Milliseconds of one frame for uploads; default 3, and at most 1.5 while a headset shows unless set. */
  readonly uploadBudgetMs?: number;
}

const DEFAULT_GPU_BYTES = 128 * 1024 * 1024;
const DEFAULT_UPLOAD_BUDGET_MS = 3;
/** A headset draws twice in 11 to 14 ms. */
const HEADSET_UPLOAD_BUDGET_MS = 1.5;
/**
 * Bytes that one frame may hand to the driver, however fast it takes them: what it puts off it does within a later frame,
 * where nobody measures it.
 */
const MAX_FRAME_UPLOAD_BYTES = 6 * 1024 * 1024;
/** Segments decoded ahead of their upload. Small ones need many, since each takes two frames; textures take 22 MB each. */
const MAX_IN_FLIGHT = 16;
const MAX_IN_FLIGHT_BYTES = 64 * 1024 * 1024;
/** Segments that are freed, or drawn for the first time, in one frame. */
const MAX_FRAME_FREES = 8;
const MAX_FRAME_WARMINGS = 8;
/** Revision of the base's list for what was visible when the context was lost: above any of a coming set. */
const RESTORED_REVISION = Number.MAX_SAFE_INTEGER;
/** How old the stream's counters may be. */
const STATS_EVERY_MS = 500;

/** See the head of the file. Owns what it puts on the GPU; `dispose` gives it back. */
export class Stage implements Landings {
  /** To be added to the scene, at the frame's origin, and never moved. */
  readonly object = new Group();
  readonly #renderer: WebGLRenderer;
  readonly #stream: Stream;
  readonly #residency: Residency;
  readonly #material: GroundMaterial;
  readonly #times = new FrameTimes();
  readonly #store: GpuStore;
  #files: SceneFiles;
  #base: BaseGround;
  #baseBoxes: Pickable;
  #uploadBudgetMs: number | null;
  #mode: ViewMode = { kind: "colour" };
  /** Everything on its way to the GPU, or there, by id. */
  #grounds = new Map<number, SegmentGround>();
  /** Of these, the ones that are shown; after a change of version, those of the old one. */
  #shown = new Map<number, SegmentGround>();
  #warming: SegmentGround[] = [];
  #freeing: SegmentGround[] = [];
  #digest: VisibleDigest | null = null;
  #isLost = false;
  #isOldVersion = false;
  #isDisposed = false;
  #streamStats: StreamStats | null = null;
  #statsAskedAtMs = Number.NEGATIVE_INFINITY;

  constructor(options: StageOptions) {
    this.#renderer = options.renderer;
    this.#stream = options.stream;
    this.#files = options.files;
    this.#uploadBudgetMs = options.uploadBudgetMs ?? null;
    this.#residency = new Residency({
      maxInFlight: MAX_IN_FLIGHT,
      maxInFlightBytes: MAX_IN_FLIGHT_BYTES,
      spareBytes: options.gpuBytes ?? DEFAULT_GPU_BYTES,
    });
    this.#store = new GpuStore(options.renderer);
    this.#material = new GroundMaterial(options.files.manifest.stepM, options.files.regions);
    this.#base = new BaseGround(this.#store, options.files, this.#material);
    this.#baseBoxes = pickableBase(options.files);
    this.object.name = "ground";
    this.object.matrixAutoUpdate = false;
    this.object.add(this.#base.mesh);
  }

  /** Box of the scene. */
  get bounds(): Bounds {
    return this.#files.manifest.bounds;
  }

  get status(): LandingStatus {
    return statusOf(this.#residency, !this.#isOldVersion && !this.#isLost);
  }

  /** Segments shown, ascending. */
  get visible(): readonly number[] {
    return this.#residency.visible;
  }

  get mode(): ViewMode {
    return this.#mode;
  }

  /** Milliseconds of one frame for uploads; may be set at any time, and counts as it is then. */
  get uploadBudgetMs(): number {
    const most = this.#renderer.xr.isPresenting ? HEADSET_UPLOAD_BUDGET_MS : DEFAULT_UPLOAD_BUDGET_MS;
    return this.#uploadBudgetMs ?? most;
  }

  set uploadBudgetMs(budgetMs: number) {
    this.#uploadBudgetMs = budgetMs;
  }

  land(position: Vec3, radiusM: number, options?: LandOptions): number {
    const landing = this.#stream.land(position, radiusM, options);
    this.#residency.land(landing, position, radiusM, performance.now());
    return landing;
  }

  aim(position: Vec3, radiusM: number): void {
    this.#stream.aim(position, radiusM);
  }

  /** Pass every event of the stream on. */
  handle(event: StreamEvent): void {
    const residency = this.#residency;
    switch (event.type) {
      case "opened":
        if (event.changed) {
          this.#leaveVersion();
        }
        break;
      case "planned":
        residency.planned(event.plan);
        break;
      case "arrived":
        residency.arrived(event.facts, event.landing);
        break;
      case "degraded":
        residency.degraded(event.landing, event.segments);
        break;
      case "ready":
        residency.ready(event.landing, event.visible, event.missing, event.elapsedMs, event.payloadBytes);
        break;
      case "refused":
        if (event.landing !== null) {
          residency.refused(event.landing, event.message);
        }
        break;
      case "dropped":
        residency.dropped(event.segments);
        break;
      default:
        break;
    }
  }

  /** Once per frame, before render: ask for meshes, upload, free, within the budget. */
  update(_camera: Camera): void {
    if (this.#isLost || this.#isDisposed) {
      return;
    }
    const startMs = performance.now();
    this.#endWarming();
    this.#finishRestoring();
    this.#askForMeshes();
    this.#free();
    this.#prepareBase();
    const endMs = startMs + this.uploadBudgetMs;
    let bytes = 0;
    while (bytes < MAX_FRAME_UPLOAD_BYTES && performance.now() < endMs) {
      const slice = this.#base.step() || this.#stepSegment();
      if (slice === 0) {
        break;
      }
      bytes += slice;
    }
    if (!this.#residency.restoring && this.#base.preparedRevision === this.#residency.comingRevision) {
      this.#residency.basePrepared(this.#base.preparedRevision);
    }
    const nowMs = performance.now();
    this.#residency.settle(nowMs);
    this.#times.add(nowMs - startMs);
  }

  /** Show the presentable set: flags only. Null where nothing is presentable. */
  swap(): SwapReport | null {
    const swap = this.#isLost || this.#isOldVersion ? null : this.#residency.swap();
    if (!swap) {
      return null;
    }
    for (const segment of swap.hidden) {
      this.#setShown(segment, false);
    }
    for (const segment of swap.shown) {
      this.#setShown(segment, true);
    }
    this.#base.flip();
    return {
      landing: swap.landing,
      shown: swap.shown,
      hidden: swap.hidden,
      hiddenBaseFaces: this.#base.hiddenCount,
      degraded: swap.degraded,
    };
  }

  cast(origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null {
    return castGround(this.#shownGround(), origin, direction, maxDistanceM);
  }

  groundAt(x: number, z: number, fromY: number): GroundHit | null {
    return groundOnVertical(this.#shownGround(), x, z, fromY);
  }

  /** How the ground is coloured from the next frame on. */
  setMode(mode: ViewMode, theme: Theme = "light"): void {
    this.#mode = mode;
    this.#material.setMode(mode, theme);
    for (const ground of new Set([...this.#grounds.values(), ...this.#shown.values()])) {
      ground.setMeasure(this.#measureName);
    }
    this.#base.setMeasure(this.#measureName);
  }

  /** CSS colour of a region of this scene version, in mode `regions`. */
  regionColour(id: number): string {
    const stableId = this.#files.regions.find((region) => region.id === id)?.stableId;
    return toCss(regionColour(stableId ?? id));
  }

  /** CSS colour of a segment in mode `segments`. */
  segmentColour(id: number): string {
    return toCss(segmentColour(id));
  }

  /** See {@link VisibleDigest}: worked out from what is drawn, at a cost of microseconds. */
  visibleDigest(): VisibleDigest {
    return this.#digest ?? this.#digestOfDrawn();
  }

  stats(): StageStats {
    this.#refreshStreamStats();
    const { bufferBytes, textureBytes, createdBytes, freedBytes } = this.#store;
    let visibleTriangles = this.#base.isThere ? this.#base.faceCount - this.#base.hiddenCount : 0;
    let pickingBytes = this.#baseBoxes.boxes.bytes;
    for (const ground of this.#shown.values()) {
      visibleTriangles += ground.faceCount;
    }
    for (const ground of this.#grounds.values()) {
      pickingBytes += ground.boxes.bytes;
    }
    return {
      stream: this.#streamStats,
      gpu: {
        segments: this.#grounds.size,
        visibleSegments: this.#shown.size,
        bufferBytes,
        textureBytes,
        createdBytes,
        freedBytes,
      },
      pickingBytes,
      visibleTriangles,
      updateMaxMs: this.#times.maxMs,
      updateMedianMs: this.#times.medianMs,
    };
  }

  /** Call on the canvas's webglcontextlost: everything on the GPU is gone. */
  contextLost(): void {
    this.#digest ??= this.#digestOfDrawn();
    this.#isLost = true;
    this.#residency.contextLost();
    for (const ground of [...new Set([...this.#grounds.values(), ...this.#shown.values(), ...this.#freeing])]) {
      ground.free();
    }
    this.#grounds.clear();
    this.#shown.clear();
    this.#warming = [];
    this.#freeing = [];
    this.#base.dispose();
  }

  /** Call on webglcontextrestored. Until the visible set is back the base is drawn whole; then all of it at once. */
  contextRestored(): void {
    if (!this.#isLost || this.#isDisposed) {
      return;
    }
    this.#isLost = false;
    this.#makeBase();
    if (!this.#residency.restoring) {
      this.#digest = null;
    }
  }

  /** Base, cover and regions of the version that an `opened` event with `changed` announced; what was shown of the old goes. */
  replaceFiles(files: SceneFiles): void {
    this.#files = files;
    this.#isOldVersion = false;
    this.#digest = null;
    this.#freeing.push(...this.#shown.values());
    for (const ground of this.#shown.values()) {
      ground.mesh?.removeFromParent();
    }
    this.#shown.clear();
    this.#residency.clearVisible();
    this.#material.setRegions(files.regions);
    this.#baseBoxes = pickableBase(files);
    this.#base.dispose();
    this.#makeBase();
  }

  /** Free everything, at once. The stream is not closed. */
  dispose(): void {
    this.#isDisposed = true;
    for (const ground of new Set([...this.#grounds.values(), ...this.#shown.values(), ...this.#freeing])) {
      ground.free();
    }
    this.#grounds.clear();
    this.#shown.clear();
    this.#warming = [];
    this.#freeing = [];
    this.#base.dispose();
    this.#material.dispose();
    this.object.removeFromParent();
  }

  get #measureName(): string | null {
    return this.#mode.kind === "attribute" ? this.#mode.name : null;
  }

  #makeBase(): void {
    this.#base = new BaseGround(this.#store, this.#files, this.#material);
    this.#base.setMeasure(this.#measureName);
    this.object.add(this.#base.mesh);
  }

  /** What is shown stays drawn until the new version's files are here; it must not be taken for segments of the new. */
  #leaveVersion(): void {
    this.#residency.versionChanged();
    this.#isOldVersion = true;
    for (const [segment, ground] of this.#grounds) {
      if (this.#shown.get(segment) !== ground) {
        this.#freeing.push(ground);
      }
    }
    this.#grounds = new Map();
    this.#warming = [];
  }

  #setShown(segment: number, isShown: boolean): void {
    const ground = isShown ? this.#grounds.get(segment) : this.#shown.get(segment);
    if (!ground?.mesh) {
      return;
    }
    ground.mesh.visible = isShown;
    if (isShown) {
      this.#shown.set(segment, ground);
    } else {
      this.#shown.delete(segment);
    }
  }

  #askForMeshes(): void {
    for (const { segment, epoch } of this.#residency.takeDecodes()) {
      this.#stream.mesh(segment).then(
        (data) => this.#onMesh(segment, data, epoch),
        () => this.#residency.decodeFailed(segment, epoch),
      );
    }
  }

  #onMesh(segment: number, data: MeshData, epoch: number): void {
    if (this.#isDisposed || !this.#residency.decoded(segment, epoch, gpuBytesOf(data))) {
      data.image?.bitmap.close();
      return;
    }
    this.#grounds.set(segment, new SegmentGround(this.#store, data, this.#material, this.#measureName));
  }

  #stepSegment(): number {
    const segment = this.#residency.nextUpload();
    const ground = segment === null ? undefined : this.#grounds.get(segment);
    if (!ground || ground.mesh || this.#warming.length >= MAX_FRAME_WARMINGS) {
      return 0;
    }
    const bytes = ground.step();
    if (ground.mesh) {
      this.object.add(ground.mesh);
      this.#warming.push(ground);
      this.#residency.uploaded(ground.segment);
    }
    return bytes;
  }

  /** Whatever was warmed was drawn since the last call. */
  #endWarming(): void {
    for (const ground of this.#warming) {
      ground.endWarming();
      this.#residency.warmed(ground.segment);
    }
    this.#warming = [];
  }

  /** Take what is to be freed out of the way at once, and give a few of them back to the driver. */
  #free(): void {
    for (const segment of this.#residency.takeFreed()) {
      const ground = this.#grounds.get(segment);
      if (ground) {
        this.#grounds.delete(segment);
        this.#warming = this.#warming.filter((other) => other !== ground);
        ground.mesh?.removeFromParent();
        this.#freeing.push(ground);
      }
    }
    for (const ground of this.#freeing.splice(0, MAX_FRAME_FREES)) {
      ground.free();
    }
  }

  #prepareBase(): void {
    if (this.#isOldVersion) {
      return;
    }
    if (this.#residency.restoring) {
      const back = this.#residency.restorable();
      if (back) {
        this.#base.prepare(back, RESTORED_REVISION);
      }
    } else if (this.#residency.coming) {
      this.#base.prepare(this.#residency.coming, this.#residency.comingRevision);
    }
  }

  #finishRestoring(): void {
    if (!this.#residency.restoring || this.#base.preparedRevision !== RESTORED_REVISION) {
      return;
    }
    this.#residency.restored();
    for (const segment of this.#residency.visible) {
      this.#setShown(segment, true);
    }
    this.#base.flip();
    this.#digest = null;
  }

  #digestOfDrawn(): VisibleDigest {
    let hash = 0;
    let count = 0;
    for (const [segment, ground] of this.#shown) {
      if (ground.mesh?.visible) {
        hash ^= mix32(segment);
        count += 1;
      }
    }
    return `${count}:${(hash >>> 0).toString(16)}:${this.#base.hiddenCount}:${this.#base.hiddenHash.toString(16)}`;
  }

  #shownGround(): ShownGround {
    return {
      segments: this.#shown.values(),
      base: this.#baseBoxes,
      hidden: this.#base.hidden,
      pushM: this.#files.manifest.deviationM,
    };
  }

  #refreshStreamStats(): void {
    const nowMs = performance.now();
    if (nowMs - this.#statsAskedAtMs > STATS_EVERY_MS) {
      this.#statsAskedAtMs = nowMs;
      this.#stream.stats().then(
        (stats) => {
          this.#streamStats = stats;
        },
        () => undefined, // A closed stream counts nothing any more; the last figures stay.
      );
    }
  }
}

function pickableBase(files: SceneFiles): Pickable {
  return { segment: -1, bounds: files.base.bounds, boxes: new FaceBoxes(files.base) };
}
