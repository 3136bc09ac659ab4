/**
 * A scene in a three.js application: base mesh, segments of the newest landing, and the swap between two landings.
 *
 * What is visible changes in {@link Terrain.swap} alone, which sets flags: buffers, textures and the base's next list of
 * faces were uploaded before, a few milliseconds in each frame's `update`. (segment-set.ts decides what is uploaded.)
 */

import {
  Group,
  type Intersection,
  Matrix4,
  type Object3DEventMap,
  PerspectiveCamera,
  type Raycaster,
  Vector3,
  type WebGLRenderer,
} from "three";

import { budgetsFor, type DeviceBudgets, type DeviceClass } from "../core/budgets.ts";
import { loadSceneInWorker } from "../core/client/load-scene.ts";
import { openStream } from "../core/client/open-stream.ts";
import { sharesOf } from "../core/gpu-budget.ts";
import { coarseRadiusOf, defaultRadiusM, waitingOf } from "../core/landing-defaults.ts";
import { StreamError } from "../core/scene/errors.ts";
import type {
  Bounds,
  LandOptions,
  LinkState,
  PickHit,
  SceneFiles,
  Stream,
  StreamEvent,
  TaughtPicture,
  Token,
  Vec3,
} from "../core/types.ts";
import { BaseGround } from "./base-ground.ts";
import { deviceBudgets } from "./device.ts";
import { Display, type Theme } from "./display.ts";
import { type Gain, gainOf } from "./gain.ts";
import { GpuStore } from "./gpu-store.ts";
import { GroundMaterial } from "./ground-material.ts";
import { castGround, groundOnVertical, type Pickable, pickableBase, type ShownGround } from "./ground-picking.ts";
import type { Shading } from "./ground-shading.ts";
import { type ShowableSet, statusOf } from "./landing.ts";
import { emptyPage } from "./page.ts";
import { regionColour, segmentColour, toCss } from "./palette.ts";
import { PendingLanding } from "./pending-landing.ts";
import { SegmentSet } from "./segment-set.ts";
import { StreamCounters, terrainStats } from "./terrain-stats.ts";
import type {
  GroundHit,
  LandingStatus,
  Landings,
  MiniaturePose,
  SwapReport,
  TerrainStats,
  ViewMode,
  VisibleDigest,
} from "./types.ts";
import { UploadBudget } from "./upload-budget.ts";
import { modeFrom } from "./view-modes.ts";

/** How a terrain is drawn. */
interface DrawOptions {
  readonly renderer: WebGLRenderer;
  /** How the ground takes part in the scene around it; see {@link Terrain.setShading}. */
  readonly shading?: Shading;
  /**
   * Milliseconds of one frame for uploads. Default 1.5 in a headset; else 3, or, where frames are slow anyway, a seventh of
   * their interval up to 30 ms, so that a landing does not take ten times as long there.
   */
  readonly uploadBudgetMs?: number;
  /** Whether `update` shows a landing as soon as it can be shown. Default true; see {@link Terrain.autoSwap}. */
  readonly autoSwap?: boolean;
}

/** Options of {@link Terrain.open}. */
export interface TerrainOpenOptions extends DrawOptions {
  /** Bearer token, or a function that returns the current one. */
  readonly token?: Token;
  /** Which limits apply. Default: that of this device, as far as the browser says. */
  readonly device?: DeviceClass;
  /** Limits that differ from those of the device. */
  readonly budgets?: Partial<DeviceBudgets>;
  /** Called while the base is loaded. */
  readonly onProgress?: (doneBytes: number, totalBytes: number) => void;
  /** Ends the loading. */
  readonly signal?: AbortSignal;
}

/** Options of the constructor, for applications that load the files and make the stream themselves. */
export interface TerrainOptions extends DrawOptions {
  /** Not closed by `dispose`. Its events must be passed to {@link Terrain.handle}. */
  readonly stream: Stream;
  readonly files: SceneFiles;
  /** Default: those of a desktop computer. */
  readonly budgets?: DeviceBudgets;
  /**
   * Loads the files of another version, when the service publishes one. Without it the application gives them to
   * {@link Terrain.replaceFiles} where {@link Terrain.neededVersion} is not null.
   */
  readonly loadFiles?: (version: string) => Promise<SceneFiles>;
}

/** Events of a {@link Terrain}, for `addEventListener`. */
export interface TerrainEventMap extends Object3DEventMap {
  /** The newest landing began, advanced or ended. */
  landing: { readonly status: LandingStatus };
  /** What is visible changed. */
  swapped: { readonly report: SwapReport };
  /** A landing is shown whole. */
  landed: { readonly status: LandingStatus };
  /** A landing was refused, the connection is closed for good, or a new version cannot be loaded. */
  failed: { readonly error: StreamError };
  link: { readonly link: LinkState };
  /** `files` changed: the base replaced the overview, or another version the one before. */
  replaced: object;
  /** Any event of the stream, after the terrain has used it. */
  stream: { readonly event: StreamEvent };
  /** The graphics context was lost, or came back. */
  contextlost: object;
  contextrestored: object;
}

/** x, y, z in metres of the scene frame, as a tuple or a `Vector3`. */
export type Place = Vec3 | { readonly x: number; readonly y: number; readonly z: number };

/**
 * Bytes that one frame may hand to the driver, however fast it takes them: what it puts off it does within a later frame,
 * where nobody measures it.
 */
const MAX_FRAME_UPLOAD_BYTES = 6 * 1024 * 1024;

/**
 * A scene to be added to a three.js scene: the base mesh of everything, and full detail around one place at a time.
 *
 * ```ts
 * const ground = await Terrain.open("https://survey.example/scenes/quarry", { renderer });
 * scene.add(ground);
 * await ground.land([0, 2, 0], 30);
 * renderer.setAnimationLoop(() => {
 *   ground.update();
 *   renderer.render(scene, camera);
 * });
 * ```
 *
 * It can be moved, rotated, scaled and mirrored as any object; a matrix that shears is not supported. Positions, directions
 * and distances that its methods take and return are in the frame of the scene, which is its local frame: `worldToLocal` and
 * `localToWorld` convert. `raycast` is three.js's own and works in world space: `raycaster.intersectObject(ground)`.
 *
 * It owns what it puts on the GPU; `dispose` frees it.
 */
export class Terrain extends Group<TerrainEventMap> implements Landings {
  /**
   * Whether `update` shows a landing as soon as it can be shown. An application that wants to choose the frame, such as one
   * that fades to black, sets it to false and calls {@link swap} when `status.phase` is "presentable" or
   * "degraded-presentable".
   */
  autoSwap: boolean;
  /** Whether landings show the coarser level, where the scene has one, beyond their radius. */
  showsCoarse = true;
  readonly stream: Stream;
  readonly #renderer: WebGLRenderer;
  readonly #budgets: DeviceBudgets;
  readonly #loadFiles: ((version: string) => Promise<SceneFiles>) | null;
  readonly #material: GroundMaterial;
  readonly #segments: SegmentSet;
  readonly #uploadBudget: UploadBudget;
  readonly #display: Display;
  readonly #counters: StreamCounters;
  readonly #store: GpuStore;
  readonly #abort = new AbortController();
  /** Parent of everything that is drawn; hidden while nothing can be drawn. */
  readonly #content = new Group();
  #ownsStream = false;
  #files: SceneFiles;
  #base: BaseGround;
  #baseBoxes: Pickable;
  #digest: VisibleDigest | null = null;
  #isLost = false;
  #isOldVersion = false;
  /** The overview, until the base that replaces it is on the GPU. */
  #leavingBase: BaseGround | null = null;
  /** Version of the session; null before it is open. */
  #servedVersion: string | null = null;
  #isDisposed = false;
  #link: LinkState | null = null;
  #pending: PendingLanding | null = null;
  #reported: LandingStatus | null = null;
  /** The last landing of which `landed` was dispatched. */
  #landed = 0;

  /**
   * Open a scene. The promise is fulfilled when there is something to draw: the overview, where the scene has one, which the
   * base then replaces; else the base.
   *
   * @param sceneUrl - ends in `/scenes/ID`.
   * @throws StreamError where the scene cannot be loaded; TypeError without WebGL 2; the reason of an aborted `signal`.
   */
  static open(sceneUrl: string, options: TerrainOpenOptions): Promise<Terrain> {
    const { token, signal, onProgress } = options;
    const budgets = { ...deviceBudgets(options.device), ...options.budgets };
    const loadFiles = async (version?: string, onOverview?: (files: SceneFiles) => void): Promise<SceneFiles> => {
      const now = typeof token === "function" ? await token() : token;
      return loadSceneInWorker(sceneUrl, { token: now, version, signal, onProgress, onOverview });
    };
    const make = (files: SceneFiles): Terrain => {
      const stream = openStream({
        sceneUrl,
        ...(token === undefined ? {} : { token }),
        budgets: sharesOf(budgets, files).budgets,
        cacheBytes: budgets.cacheBytes,
        diskBytes: budgets.diskBytes,
        creditBytes: budgets.creditBytes,
      });
      try {
        const terrain = new Terrain({ ...options, budgets, stream, files, loadFiles });
        stream.onEvent = (event) => terrain.handle(event);
        terrain.#ownsStream = true;
        return terrain;
      } catch (error) {
        stream.close(); // No terrain owns it: it would stay connected.
        throw error;
      }
    };
    return new Promise((resolve, reject) => {
      let terrain: Terrain | null = null;
      const show = (files: SceneFiles): void => {
        if (terrain !== null) {
          terrain.#replaceOverview(files);
          return;
        }
        terrain = make(files);
        resolve(terrain);
      };
      const onOverview = (files: SceneFiles): void => {
        try {
          show(files);
        } catch (error) {
          reject(error);
        }
      };
      loadFiles(undefined, onOverview)
        .then(show)
        .catch((error: unknown) => {
          reject(error);
          terrain?.fail(error);
        });
    });
  }

  constructor(options: TerrainOptions) {
    super();
    const { renderer, stream, files, budgets = budgetsFor("desktop") } = options;
    this.name = "terrain";
    this.autoSwap = options.autoSwap ?? true;
    this.stream = stream;
    this.#renderer = renderer;
    this.#files = files;
    this.#budgets = budgets;
    this.#loadFiles = options.loadFiles ?? null;
    this.#uploadBudget = new UploadBudget(options.uploadBudgetMs ?? null);
    this.#counters = new StreamCounters(stream);
    const { spareGpuBytes, maxGpuBytes } = sharesOf(budgets, files);
    this.#store = new GpuStore(renderer);
    this.#material = new GroundMaterial(files.manifest, files.regions);
    this.#segments = new SegmentSet({
      parent: this.#content,
      store: this.#store,
      material: this.#material,
      maxGpuBytes,
      spareGpuBytes,
      decode: (key) => stream.mesh(key, this.#files.manifest.attributes),
    });
    this.#display = new Display(this.#material, this.#segments);
    this.#base = new BaseGround(this.#store, files, this.#material);
    this.#baseBoxes = pickableBase(files);
    this.setShading(options.shading ?? {});
    this.add(this.#content);
    this.#content.add(this.#base.mesh);
    const { signal } = this.#abort;
    renderer.domElement.addEventListener("webglcontextlost", () => this.#contextLost(), { signal });
    renderer.domElement.addEventListener("webglcontextrestored", () => this.#contextRestored(), { signal });
    this.#compile();
  }

  /** Box of the scene. */
  get bounds(): Bounds {
    return this.#files.manifest.bounds;
  }

  get status(): LandingStatus {
    return statusOf(this.#segments.newest, this.#presentable, (key) => this.#segments.isOnGpu(key));
  }

  /** What is known of the scene, and its base; of the overview until the base is here. */
  get files(): SceneFiles {
    return this.#files;
  }

  /** Radius of a landing that names none: by the device, the size and the density of the scene, metres. */
  get defaultRadiusM(): number {
    return defaultRadiusM(this.#files.manifest, this.#budgets);
  }

  /** State of the connection; null before the first attempt. */
  get link(): LinkState | null {
    return this.#link;
  }

  /** Numbers of the segments shown, ascending; those at the coarser level are counted on from the finer ones. */
  get shownSegments(): readonly number[] {
    const { segmentCount } = this.#files.manifest;
    const numbers = this.#segments.visible?.segments.map(
      ({ segment, isCoarser }) => segment + (isCoarser ? segmentCount : 0),
    );
    return numbers?.sort((a, b) => a - b) ?? [];
  }

  get mode(): ViewMode {
    return this.#display.mode;
  }

  /**
   * Whether `update` has work left: an application that draws only when something changes must go on drawing while it is
   * true. The picture changes in `update` (arrival of the base, a restored context, swaps), `swap`, and the setters.
   */
  get busy(): boolean {
    if (this.#isLost || this.#isDisposed) {
      return false;
    }
    const { next } = this.#segments;
    const isBaseBehind = !this.#isBehind && next !== null && !this.#base.isPreparedFor(next.hidden);
    return (
      this.#display.isFading ||
      !this.#content.visible ||
      !this.#base.isUploaded ||
      isBaseBehind ||
      this.#segments.isBusy
    );
  }

  /** Milliseconds of one frame for uploads; may be set at any time, and counts as it is then. */
  get uploadBudgetMs(): number {
    return this.#uploadBudget.ms(this.#renderer.xr.isPresenting);
  }

  set uploadBudgetMs(budgetMs: number) {
    this.#uploadBudget.set(budgetMs);
  }

  /**
   * Show full detail within a radius about a place, and there alone. What is shown stays until all of it is on the GPU.
   *
   * The promise is fulfilled when the landing is shown whole. It is rejected with a StreamError where the landing is refused or
   * superseded by a newer one, or where there is no connection for 15 s (it is shown all the same once there is one).
   *
   * @throws RangeError for numbers that the protocol does not allow.
   */
  land(position: Place, radiusM: number = this.defaultRadiusM, options: LandOptions = {}): Promise<LandingStatus> {
    const place = vec3Of(position);
    const coarseRadiusM = this.#coarseRadiusM(radiusM);
    const landOptions: LandOptions = {
      ...waitingOf(radiusM, this.#renderer.xr.isPresenting),
      ...(coarseRadiusM !== undefined && { coarseRadiusM }),
      ...options,
    };
    const landing = this.stream.land(place, radiusM, landOptions);
    this.#segments.land(landing, place, radiusM, performance.now(), landOptions);
    this.#pending?.reject("superseded", `superseded by landing ${landing}`);
    const pending = new PendingLanding();
    this.#pending = pending;
    pending.followLink(this.#link);
    this.#reportLanding();
    return pending.promise;
  }

  /** Load what a landing there would need, when no landing waits for the connection. For the place that the user points at. */
  prefetch(position: Place, radiusM: number = this.defaultRadiusM): void {
    this.stream.aim(vec3Of(position), radiusM, this.#coarseRadiusM(radiusM));
  }

  /**
   * Ask the service for the full detail along a ray, or without a direction on the vertical line through a point: its survey
   * attributes, region and height. Null where nothing is met; rejects with a StreamError where it is refused.
   */
  pick(origin: Place, direction?: Place): Promise<PickHit | null> {
    return this.stream.pick(vec3Of(origin), direction && vec3Of(direction));
  }

  /** Take an event of the stream. {@link Terrain.open} connects this; for others, every event must be passed. */
  handle(event: StreamEvent): void {
    this.#segments.handle(event);
    if (event.type === "opened") this.#sessionOpened(event.sceneVersion, event.changed);
    else if (event.type === "link") this.#followLink(event.link);
    else if (event.type === "refused" && event.landing !== null) {
      const error = new StreamError(event.code, event.message);
      if (event.landing === this.status.landing) this.#pending?.reject(event.code, event.message);
      this.fail(error);
    }
    this.#reportLanding();
    this.dispatchEvent({ type: "stream", event });
  }

  /** Dispatch `failed`. */
  fail(error: unknown): void {
    const known = error instanceof StreamError ? error : new StreamError("worker_failed", String(error));
    this.dispatchEvent({ type: "failed", error: known });
  }

  /** Call once a frame, before rendering: uploads what came, within the budget, and shows a landing when all of it is there. */
  update(): void {
    if (this.#isLost || this.#isDisposed) {
      return;
    }
    const startMs = performance.now();
    this.#uploadBudget.begin(startMs);
    // Of another version the attributes' scales are not here yet.
    this.#segments.update(!this.#isOldVersion);
    this.#restore();
    const { next } = this.#segments;
    if (next !== null && !this.#isBehind && !this.#base.isPreparedFor(next.hidden)) this.#base.prepare(next.hidden);
    const endMs = startMs + this.uploadBudgetMs;
    let bytes = 0;
    // The base goes first: without its list for the coming set no swap is possible, however many segments are there.
    while (bytes < MAX_FRAME_UPLOAD_BYTES && performance.now() < endMs) {
      const slice = this.#base.step() || this.#segments.step();
      if (slice === 0) {
        break;
      }
      bytes += slice;
    }
    // In the frame that first draws the base: the ground is there throughout, and never twice.
    if (this.#base.isUploaded) this.#endLeaving();
    const nowMs = performance.now();
    this.#segments.settle(nowMs, this.#presentable);
    this.#display.update(nowMs, this.#base, this.#renderer);
    this.#uploadBudget.end(nowMs);
    if (!this.autoSwap || this.swap() === null) this.#reportLanding();
  }

  /** Show the landing that is presentable, in this frame: flags only. Null where none is. `update` does it by default. */
  swap(): SwapReport | null {
    const set = this.#presentable;
    if (set === null) return null;
    // One frame, flags alone: a segment and the base faces under it are never both missing, nor both drawn.
    const { shown, hidden, isWhole } = this.#segments.swap(set);
    this.#base.flip();
    this.#digest = null;
    this.#display.swapped(shown);
    const { landing } = this.#segments.newest!;
    const report = { landing, shown, hidden, hiddenBaseFaces: this.#base.hiddenCount, degraded: !isWhole };
    this.dispatchEvent({ type: "swapped", report });
    this.#reportLanding();
    return report;
  }

  /** three.js's own ray test, in world space: `raycaster.intersectObject(terrain)`. What is met is the ground that is shown. */
  override raycast({ ray, near, far }: Raycaster, intersects: Intersection[]): void {
    const intoFrame = new Matrix4().copy(this.matrixWorld).invert();
    const origin = ray.origin.clone().applyMatrix4(intoFrame);
    const direction = ray.origin.clone().add(ray.direction).applyMatrix4(intoFrame).sub(origin);
    // Distances along the ray scale with its direction.
    const scale = direction.length();
    const from = origin.addScaledVector(direction, near);
    const hit = this.cast(from.toArray(), direction.toArray(), (far - near) * scale);
    if (hit === null) return;
    const distance = near + hit.distanceM / scale;
    const intersection: TerrainIntersection = {
      distance,
      point: ray.at(distance, new Vector3()),
      normal: new Vector3(...hit.normal),
      object: this,
      ground: hit,
    };
    intersects.push(intersection);
  }

  /** Height of the ground that is shown at (x, z): the highest, or the highest not above `fromY`; null where there is none. */
  heightAt(x: number, z: number, fromY: number = this.bounds[4] + 1): number | null {
    return this.groundAt(x, z, fromY)?.position[1] ?? null;
  }

  cast(origin: Vec3, direction: Vec3, maxDistanceM: number): GroundHit | null {
    return castGround(this.#shownGround(), origin, direction, maxDistanceM);
  }

  groundAt(x: number, z: number, fromY: number): GroundHit | null {
    return groundOnVertical(this.#shownGround(), x, z, fromY);
  }

  /** Tint what the newest swap has shown for a moment: that is what became sharp. */
  markFresh(): void {
    this.#display.markFresh(performance.now());
  }

  /** Draw the base alone left of this share of the picture's width, what is shown right of it; null ends it. */
  setSplit(share: number | null): void {
    this.#display.split = share;
  }

  /**
   * Draw the whole base once more, small, as a model of the scene, from the next `update` on; null takes it away. It is no part
   * of what is visible: nothing meets it, and it counts in no digest.
   */
  setMiniature(pose: MiniaturePose | null): void {
    this.#display.miniature = pose;
  }

  /** What full detail of the landing that is shown has made sharper; null without any. Walks the base: once per landing. */
  gain(): Gain | null {
    const { hidden } = this.#base;
    if (hidden === undefined) return null;
    const full = [...this.#segments.shown.values()].filter(({ isCoarser }) => !isCoarser);
    return gainOf(this.#files.base, hidden, full);
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
    this.#display.setMode(modeFrom(mode, manifest, regions), theme, this.#base);
  }

  /**
   * What the ground takes part in of the scene around it, from the next frame on; what is not named is as by default. Nothing
   * of it changes what is visible, or what is met by `cast`: a clipped point is met.
   */
  setShading(shading: Shading): void {
    this.#display.setShading(shading, this.#base);
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

  stats(): TerrainStats {
    const stream = this.#counters.read(performance.now());
    return terrainStats(
      stream,
      this.#store,
      this.#base,
      this.#baseBoxes.boxes,
      this.#segments,
      this.#uploadBudget.times,
    );
  }

  /** Version whose files {@link replaceFiles} needs; null where the session's are here. */
  get neededVersion(): string | null {
    return this.#isOldVersion ? this.#servedVersion : null;
  }

  /**
   * Take base and regions of {@link neededVersion}, or those that the overview stands for; what was shown of the old version
   * goes. Others are ignored: of another version, where the session has gone on meanwhile; or the same a second time, where
   * it went to another version and back.
   */
  replaceFiles(files: SceneFiles): void {
    const { version } = files.manifest;
    const replacesOverview = this.#files.isOverview === true && version === this.#files.manifest.version;
    if (this.#isDisposed || (version !== this.neededVersion && (this.#isOldVersion || !replacesOverview))) return;
    if (replacesOverview) this.#leavingBase = this.#base;
    this.#files = files;
    this.#isOldVersion = false;
    this.#digest = null;
    this.#segments.hideAll();
    this.#material.setVersion(files.manifest, files.regions);
    this.#baseBoxes = pickableBase(files);
    if (this.#leavingBase === null) this.#base.dispose();
    this.#makeBase();
    this.dispatchEvent({ type: "replaced" });
  }

  /** Free everything and leave the scene. Also closes the connection that {@link Terrain.open} made. */
  override dispose(): void {
    super.dispose?.(); // Since three.js 0.183.
    this.#isDisposed = true;
    this.#abort.abort();
    this.#pending?.reject("closed", "the terrain was disposed");
    if (this.#ownsStream) this.stream.close();
    this.#segments.freeAll();
    this.#base.dispose();
    this.#endLeaving();
    this.#material.dispose();
    this.removeFromParent();
  }

  /** Nothing is drawn until the shader is there: the first draw would wait for it, on some drivers for half a second. */
  #compile(): void {
    this.#content.visible = false;
    const page = emptyPage(this.#material);
    this.#content.add(page);
    const show = (): void => {
      page.removeFromParent();
      this.#content.visible = true;
    };
    this.#renderer.compileAsync(this.#content, new PerspectiveCamera()).then(show, show);
  }

  /** Everything on the GPU is gone. */
  #contextLost(): void {
    // What was visible counts as visible until it is back: its digest is that of before.
    this.#digest ??= this.#digestOfDrawn();
    this.#isLost = true;
    this.#segments.contextLost();
    this.#base.dispose();
    this.#endLeaving();
    this.dispatchEvent({ type: "contextlost" });
  }

  /** Until the visible set is back the base is drawn whole; then all of it at once. */
  #contextRestored(): void {
    if (!this.#isLost || this.#isDisposed) return;
    this.#isLost = false;
    this.#content.visible = true;
    this.#makeBase();
    if (this.#segments.visible === null) this.#digest = null;
    this.dispatchEvent({ type: "contextrestored" });
  }

  #coarseRadiusM(radiusM: number): number | undefined {
    return this.showsCoarse ? coarseRadiusOf(radiusM, this.#files.manifest) : undefined;
  }

  #sessionOpened(version: string, changed: boolean): void {
    this.#servedVersion = version;
    // Also where it was published between the files and the session: hidden faces are those of one version's base.
    if (!changed && (version === this.#files.manifest.version || this.#isOldVersion)) return;
    this.#leaveVersion();
    this.#loadVersion(version);
  }

  /** The base is here. Where the scene was published since the overview was loaded, the base that belongs to it is needed. */
  #replaceOverview(files: SceneFiles): void {
    this.replaceFiles(files);
    if (this.#files.isOverview === true) this.#loadVersion(this.#servedVersion ?? this.#files.manifest.version);
  }

  #loadVersion(version: string): void {
    this.#loadFiles?.(version).then(
      (files) => this.replaceFiles(files),
      (error: unknown) => {
        if (!this.#isDisposed) this.fail(error);
      },
    );
  }

  #followLink(link: LinkState): void {
    this.#link = link;
    this.#pending?.followLink(link);
    this.dispatchEvent({ type: "link", link });
    if (link.state === "closed") this.fail(new StreamError(link.code, link.message));
  }

  /** Dispatch `landing` where the status changed, and `landed` once the landing is shown whole. */
  #reportLanding(): void {
    const { status } = this;
    const last = this.#reported;
    const isNews = last?.landing !== status.landing || last.phase !== status.phase || last.fraction !== status.fraction;
    this.#reported = status;
    if (isNews && status.phase !== "idle") this.dispatchEvent({ type: "landing", status });
    // A return is shown before the service has answered; it counts with the answer.
    if (status.phase !== "shown" || status.readyMs === null || status.landing === this.#landed) return;
    this.#landed = status.landing;
    this.#pending?.resolve(status);
    this.#pending = null;
    this.dispatchEvent({ type: "landed", status });
  }

  #endLeaving(): void {
    this.#leavingBase?.dispose();
    this.#leavingBase = null;
  }

  #makeBase(): void {
    this.#base = new BaseGround(this.#store, this.#files, this.#material);
    this.#base.setMeasure(this.#display.measureName);
    this.#content.add(this.#base.mesh);
  }

  /** What is shown stays drawn until the new version's files are here; it must not be taken for segments of the new. */
  #leaveVersion(): void {
    this.#isOldVersion = true;
    this.#segments.leaveVersion();
  }

  /** Whether the base of what comes is not here yet: nothing of it is shown before. */
  get #isBehind(): boolean {
    return this.#isOldVersion || this.#files.isOverview === true;
  }

  /** What a swap would show now; null where nothing can be shown. */
  get #presentable(): ShowableSet | null {
    const set = this.#isLost || this.#isBehind ? null : this.#segments.presentable;
    return set !== null && this.#base.isPreparedFor(set.hidden) ? set : null;
  }

  /** After a loss of the graphics context: draw what was shown, once all of it is back. */
  #restore(): void {
    const set = this.#segments.restorable;
    if (set === null || !this.#base.isPreparedFor(set.hidden)) return;
    this.#segments.restore();
    this.#base.flip();
    this.#digest = null;
  }

  #digestOfDrawn(): VisibleDigest {
    return `${this.#segments.digest()}:${this.#base.hiddenCount}:${this.#base.hiddenHash.toString(16)}`;
  }

  #shownGround(): ShownGround {
    return {
      segments: this.#segments.shown.values(),
      base: this.#baseBoxes,
      hidden: this.#base.hidden,
      pushM: this.#files.manifest.deviationM,
    };
  }
}

/** What `Raycaster.intersectObject` returns for a terrain. */
export interface TerrainIntersection extends Intersection {
  /** The same point in the scene frame, with segment and region. */
  readonly ground: GroundHit;
}

function vec3Of(place: Place): Vec3 {
  return "x" in place ? [place.x, place.y, place.z] : place;
}
