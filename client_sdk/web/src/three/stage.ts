/**
 * The drawn scene: base mesh, segments of the newest landing, and the swap between two landings.
 *
 * What is visible changes in {@link Stage.swap} alone, which sets flags: buffers, textures and the base's next list of faces
 * were uploaded before, a few milliseconds in each frame's `update`. (core/residency.ts says what is uploaded and when.)
 */

import { Group, PerspectiveCamera, type WebGLRenderer } from "three";

import { hiddenFaces } from "../core/cover.ts";
import { gpuBytesOf } from "../core/gpu-budget.ts";
import type { Residency } from "../core/residency.ts";
import { passOn } from "../core/residency-events.ts";
import type {
  Bounds,
  LandOptions,
  MeshData,
  SceneFiles,
  Stream,
  StreamEvent,
  TaughtPicture,
  Vec3,
} from "../core/types.ts";
import { BaseGround } from "./base-ground.ts";
import { type Gain, gainOf } from "./gain.ts";
import { GpuStore } from "./gpu-store.ts";
import { GroundMaterial } from "./ground-material.ts";
import { castGround, groundOnVertical, type Pickable, pickableBase, type ShownGround } from "./ground-picking.ts";
import { GroundSet } from "./ground-set.ts";
import type { Shading } from "./ground-shading.ts";
import { statusOf } from "./landing-status.ts";
import { closeImage } from "./mesh-upload.ts";
import { emptyPage } from "./page.ts";
import { regionColour, segmentColour, toCss } from "./palette.ts";
import { StageLooks, type Theme } from "./stage-looks.ts";
import { residencyOf, type StageOptions } from "./stage-options.ts";
import { StreamCounters, stageStats } from "./stage-stats.ts";
import type {
  GroundHit,
  LandingStatus,
  Landings,
  MiniaturePose,
  StageStats,
  SwapReport,
  ViewMode,
  VisibleDigest,
} from "./types.ts";
import { UploadBudget } from "./upload-budget.ts";
import { modeFrom } from "./view-modes.ts";

export type { StageOptions, Theme };

/**
 * Bytes that one frame may hand to the driver, however fast it takes them: what it puts off it does within a later frame,
 * where nobody measures it.
 */
const MAX_FRAME_UPLOAD_BYTES = 6 * 1024 * 1024;
/** Revision of the base's list for what was visible when the context was lost: above any of a coming set. */
const RESTORED_REVISION = Number.MAX_SAFE_INTEGER;
/** Base mesh, segments of the newest landing, and the swap between two landings. Owns what it puts on the GPU; `dispose` gives it back. */
export class Stage implements Landings {
  /**
   * Add it to the scene; it can be moved, rotated and scaled as any object. All positions, directions and distances that a
   * stage accepts or returns are in the object's local frame: `object.worldToLocal` and `localToWorld` convert.
   */
  readonly object = new Group();
  readonly #renderer: WebGLRenderer;
  readonly #stream: Stream;
  readonly #residency: Residency;
  readonly #material: GroundMaterial;
  readonly #grounds: GroundSet;
  readonly #budget: UploadBudget;
  readonly #looks: StageLooks;
  readonly #counters: StreamCounters;
  readonly #store: GpuStore;
  #files: SceneFiles;
  #base: BaseGround;
  #baseBoxes: Pickable;
  #digest: VisibleDigest | null = null;
  #isLost = false;
  #isOldVersion = false;
  /** The overview, while the base takes its place: drawn until that is on the GPU. */
  #leavingBase: BaseGround | null = null;
  /** Version of the session; null before it is open. */
  #servedVersion: string | null = null;
  #isDisposed = false;

  constructor(options: StageOptions) {
    this.#renderer = options.renderer;
    this.#stream = options.stream;
    this.#files = options.files;
    this.#budget = new UploadBudget(options.uploadBudgetMs ?? null);
    this.#counters = new StreamCounters(options.stream);
    this.#residency = residencyOf(options);
    this.#store = new GpuStore(options.renderer);
    this.#material = new GroundMaterial(options.files.manifest, options.files.regions);
    this.#grounds = new GroundSet(
      this.object,
      this.#store,
      this.#material,
      this.#residency,
      options.maxGpuBytes ?? Number.POSITIVE_INFINITY,
      (id) => this.#mesh(id).then(({ image }) => image),
    );
    this.#looks = new StageLooks(this.#material, this.#grounds);
    this.#base = new BaseGround(this.#store, options.files, this.#material);
    this.#baseBoxes = pickableBase(options.files);
    this.setShading(options.shading ?? {});
    this.object.name = "ground";
    this.object.add(this.#base.mesh);
    this.#compile();
  }

  /** Box of the scene. */
  get bounds(): Bounds {
    return this.#files.manifest.bounds;
  }

  get status(): LandingStatus {
    return statusOf(this.#residency, !this.#isBehind && !this.#isLost);
  }

  /** Segments shown, ascending. */
  get visible(): readonly number[] {
    return this.#residency.visible;
  }

  get mode(): ViewMode {
    return this.#looks.mode;
  }

  /**
   * Whether `update` has something to do that was not asked for from outside: a page that rests between changes must draw on
   * while it is so. What is drawn changes in `update` (the base's arrival, a restored context), `swap`, `setMode`,
   * `highlightRegion` and `replaceFiles` alone.
   */
  get busy(): boolean {
    if (this.#isLost || this.#isDisposed) {
      return false;
    }
    const { comingRevision, coming } = this.#residency;
    const isBaseBehind = !this.#isBehind && coming !== null && this.#base.preparedRevision !== comingRevision;
    return (
      this.#looks.isFading ||
      !this.object.visible ||
      !this.#base.isUploaded ||
      isBaseBehind ||
      this.#grounds.isBusy ||
      this.#residency.isBusy
    );
  }

  /** Milliseconds of one frame for uploads; may be set at any time, and counts as it is then. */
  get uploadBudgetMs(): number {
    return this.#budget.ms(this.#renderer.xr.isPresenting);
  }

  set uploadBudgetMs(budgetMs: number) {
    this.#budget.set(budgetMs);
  }

  land(position: Vec3, radiusM: number, options?: LandOptions): number {
    const landing = this.#stream.land(position, radiusM, options);
    this.#residency.land(landing, position, radiusM, performance.now(), options);
    return landing;
  }

  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void {
    this.#stream.aim(position, radiusM, coarseRadiusM);
  }

  /** Pass every event of the stream on. */
  handle(event: StreamEvent): void {
    if (event.type !== "opened") {
      passOn(event, this.#residency);
      return;
    }
    this.#servedVersion = event.sceneVersion;
    this.#residency.sessionOpened();
    // Also where it was published between the files and the session: ids in a cover belong to one version (5.4).
    if (event.changed || (event.sceneVersion !== this.#files.manifest.version && !this.#isOldVersion)) {
      this.#leaveVersion();
    }
  }

  /** Once per frame, before render: ask for meshes, upload, free, within the budget. */
  update(): void {
    if (this.#isLost || this.#isDisposed) {
      return;
    }
    const startMs = performance.now();
    this.#budget.begin(startMs);
    this.#grounds.endWarming();
    this.#finishRestoring();
    this.#askForMeshes();
    this.#grounds.free();
    this.#prepareBase();
    const endMs = startMs + this.uploadBudgetMs;
    let bytes = 0;
    // The base goes first: without its list for the coming set no swap is possible, however many segments are there.
    while (bytes < MAX_FRAME_UPLOAD_BYTES && performance.now() < endMs) {
      const slice = this.#base.step() || this.#grounds.step();
      if (slice === 0) {
        break;
      }
      bytes += slice;
    }
    // In the frame that first draws the base: the ground is there throughout, and never twice.
    if (this.#base.isUploaded) this.#endLeaving();
    if (!this.#residency.restoring && this.#base.preparedRevision === this.#residency.comingRevision) {
      this.#residency.basePrepared(this.#base.preparedRevision);
    }
    const nowMs = performance.now();
    this.#residency.settle(nowMs);
    this.#looks.update(nowMs, this.#base, this.#renderer);
    this.#budget.end(nowMs);
  }

  /** Show the presentable set: flags only. Null where nothing is presentable. */
  swap(): SwapReport | null {
    const swap = this.#isLost || this.#isBehind ? null : this.#residency.swap();
    if (!swap) {
      return null;
    }
    // One frame, flags alone: a segment and the base faces under it are never both missing, nor both drawn.
    for (const segment of swap.hidden) {
      this.#grounds.setShown(segment, false);
    }
    for (const segment of swap.shown) {
      this.#grounds.setShown(segment, true);
    }
    this.#base.flip();
    this.#looks.swapped(swap.shown);
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

  /** Wash what the newest swap has shown with colour for a moment: that is what became sharp. */
  markFresh(): void {
    this.#looks.markFresh(performance.now());
  }

  /** Draw the base alone left of this share of the picture's width, what is shown right of it; null ends it. */
  setSplit(share: number | null): void {
    this.#looks.split = share;
  }

  /**
   * Draw the whole base once more, small, as a model of the scene, from the next `update` on; null takes it away. It is no part
   * of what is visible: nothing meets it, and it counts in no digest.
   */
  setMiniature(pose: MiniaturePose | null): void {
    this.#looks.miniature = pose;
  }

  /** What full detail of the landing that is shown has made sharper; null without any. Walks the base: once per landing. */
  gain(): Gain | null {
    const { hidden } = this.#base;
    if (hidden === undefined) return null;
    const { position, radiusM, plan } = this.status;
    const full = this.#grounds.shownAtFullDetail;
    const faces = [...full.values()].reduce((sum, ground) => sum + ground.faceCount, 0);
    return gainOf(this.#files.base, hidden, position, plan?.effectiveRadiusM ?? radiusM, faces);
  }

  /** Lay what strokes have taught over the ground; null takes it away. */
  setTaught(picture: TaughtPicture | null): void {
    this.#material.setTaught(picture);
  }

  /**
   * How the ground is coloured from the next frame on: a mode, or its text, as `slope` or `attribute:NAME`.
   *
   * @throws RangeError on what is no mode of this scene.
   */
  setMode(mode: ViewMode | string, theme: Theme = "light"): void {
    const { manifest, regions } = this.#files;
    this.#looks.setMode(modeFrom(mode, manifest, regions), theme, this.#base);
  }

  /**
   * What the ground takes part in of the scene around it, from the next frame on; what is not named is as by default. Nothing
   * of it changes what is visible, or what is met by `cast`: a clipped point is met.
   */
  setShading(shading: Shading): void {
    this.#looks.setShading(shading, this.#base);
  }

  /** Show one region in its colours and dim everything else, in every mode; null ends it. Changes nothing of what is visible. */
  highlightRegion(id: number | null): void {
    this.#material.highlight(id);
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
    const stream = this.#counters.read(performance.now());
    return stageStats(stream, this.#store, this.#base, this.#baseBoxes.boxes, this.#grounds, this.#budget.times);
  }

  /** Call on the canvas's webglcontextlost: everything on the GPU is gone. */
  contextLost(): void {
    // What was visible counts as visible until it is back: its digest is that of before.
    this.#digest ??= this.#digestOfDrawn();
    this.#isLost = true;
    this.#residency.contextLost();
    this.#grounds.freeAll();
    this.#base.dispose();
    this.#endLeaving();
  }

  /** Call on webglcontextrestored. Until the visible set is back the base is drawn whole; then all of it at once. */
  contextRestored(): void {
    if (!this.#isLost || this.#isDisposed) {
      return;
    }
    this.#isLost = false;
    this.object.visible = true;
    this.#makeBase();
    if (!this.#residency.restoring) {
      this.#digest = null;
    }
  }

  /** Version whose files are to be given to {@link replaceFiles}; null where those that are here are the session's. */
  get neededVersion(): string | null {
    return this.#isOldVersion ? this.#servedVersion : null;
  }

  /**
   * Base, cover and regions of {@link neededVersion}, or of the overview that the stage began with; what was shown of the old
   * goes. Any others are not taken: of another
   * version, where the session went on meanwhile and their ids would be taken for its; nor the same a second time, where it
   * went there and back: the base would be drawn whole over the segments that are shown by then.
   */
  replaceFiles(files: SceneFiles): void {
    const completes = this.#files.isOverview === true && files.manifest.version === this.#files.manifest.version;
    if (files.manifest.version !== this.neededVersion && (this.#isOldVersion || !completes)) {
      return;
    }
    if (completes) this.#leavingBase = this.#base;
    this.#files = files;
    this.#isOldVersion = false;
    this.#digest = null;
    this.#grounds.hideAll();
    this.#residency.clearVisible();
    this.#material.setVersion(files.manifest, files.regions);
    this.#baseBoxes = pickableBase(files);
    if (this.#leavingBase === null) this.#base.dispose();
    this.#makeBase();
  }

  /** Free everything, at once. The stream is not closed. */
  dispose(): void {
    this.#isDisposed = true;
    this.#grounds.freeAll();
    this.#base.dispose();
    this.#endLeaving();
    this.#material.dispose();
    this.object.removeFromParent();
  }

  /** Nothing is drawn until the shader is there: the first draw would wait for it, on some drivers for half a second. */
  #compile(): void {
    this.object.visible = false;
    const page = emptyPage(this.#material);
    this.object.add(page);
    const show = (): void => {
      page.removeFromParent();
      this.object.visible = true;
    };
    this.#renderer.compileAsync(this.object, new PerspectiveCamera()).then(show, show);
  }

  #endLeaving(): void {
    this.#leavingBase?.dispose();
    this.#leavingBase = null;
  }

  #makeBase(): void {
    this.#base = new BaseGround(this.#store, this.#files, this.#material);
    this.#base.setMeasure(this.#looks.measureName);
    this.object.add(this.#base.mesh);
  }

  /** What is shown stays drawn until the new version's files are here; it must not be taken for segments of the new. */
  #leaveVersion(): void {
    // Residency first: answers of decoders that are under way are of the epoch before, and are thrown away.
    this.#residency.versionChanged();
    this.#isOldVersion = true;
    this.#grounds.leaveVersion();
  }

  #askForMeshes(): void {
    // The new version's attributes are not here yet.
    if (this.#isOldVersion) return;
    for (const { segment, epoch } of this.#residency.takeDecodes()) {
      this.#mesh(segment).then(
        (data) => this.#onMesh(segment, data, epoch),
        () => this.#residency.decodeFailed(segment, epoch),
      );
    }
  }

  #mesh(segment: number): Promise<MeshData> {
    return this.#stream.mesh(segment, this.#files.manifest.attributes);
  }

  #onMesh(segment: number, data: MeshData, epoch: number): void {
    // The bitmap is this side's to close wherever the mesh is not taken: memory of images is not collected in time.
    if (this.#isDisposed || !this.#residency.decoded(segment, epoch, gpuBytesOf(data))) {
      closeImage(data.image);
      return;
    }
    this.#grounds.add(segment, data);
  }

  /** Whether base and cover of what comes are not here yet: nothing of it is shown before. */
  get #isBehind(): boolean {
    return this.#isOldVersion || this.#files.isOverview === true;
  }

  #prepareBase(): void {
    if (this.#isBehind) {
      return;
    }
    if (this.#residency.restoring) {
      const restorable = this.#residency.restorable();
      if (restorable) {
        this.#prepareHidden(restorable, RESTORED_REVISION);
      }
    } else if (this.#residency.coming) {
      this.#prepareHidden(this.#residency.coming, this.#residency.comingRevision);
    }
  }

  /** Prepare the base to be drawn without the faces under these payloads, whatever their level. */
  #prepareHidden(ids: readonly number[], revision: number): void {
    if (revision === this.#base.targetRevision) return;
    const { manifest, cover } = this.#files;
    this.#base.prepare(hiddenFaces(cover, new Set(ids.map((id) => id % manifest.segmentCount))), revision);
  }

  #finishRestoring(): void {
    if (!this.#residency.restoring || this.#base.preparedRevision !== RESTORED_REVISION) {
      return;
    }
    this.#residency.restored();
    for (const segment of this.#residency.visible) {
      this.#grounds.setShown(segment, true);
    }
    this.#base.flip();
    this.#digest = null;
  }

  #digestOfDrawn(): VisibleDigest {
    return `${this.#grounds.digest()}:${this.#base.hiddenCount}:${this.#base.hiddenHash.toString(16)}`;
  }

  #shownGround(): ShownGround {
    return {
      segments: this.#grounds.shown.values(),
      base: this.#baseBoxes,
      hidden: this.#base.hidden,
      pushM: this.#files.manifest.deviationM,
    };
  }
}
