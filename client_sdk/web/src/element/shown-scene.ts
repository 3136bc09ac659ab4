/** One scene in one canvas: stream, stage, camera and frames, from opening to `dispose`. No words, no attributes. */

import { Color, PerspectiveCamera, Raycaster, Scene, Vector2, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { type DeviceBudgets, openStream, sharesOf } from "../core/index.ts";
import { coarseRadiusOf, defaultRadiusM, waitingOf } from "../core/landing-defaults.ts";
import { StreamError } from "../core/scene/errors.ts";
import type { LandOptions, LinkState, SceneFiles, Stream, StreamEvent, Token, Vec3 } from "../core/types.ts";
import { type LandingStatus, Stage } from "../three/index.ts";
import { framing, orbitEye } from "../three/orbit-pose.ts";

/** What a scene is shown with. */
export interface ShownSceneOptions {
  readonly canvas: HTMLCanvasElement;
  readonly sceneUrl: string;
  readonly token?: Token | undefined;
  readonly files: SceneFiles;
  readonly budgets: DeviceBudgets;
  readonly loadFiles: (version: string) => Promise<SceneFiles>;
  readonly isStill: () => boolean;
  /** Of landings, metres; null where it is left to the scene. */
  readonly radiusM: () => number | null;
}

/** What it tells. */
export interface ShownSceneListeners {
  link(link: LinkState): void;
  /** While one is under way, and when it ends. */
  landing(status: LandingStatus): void;
  landed(status: LandingStatus): void;
  refused(code: string, message: string): void;
  /** A click met no ground. */
  missed(): void;
}

interface Waiting {
  readonly landing: number;
  readonly resolve: (status: LandingStatus) => void;
  readonly reject: (error: Error) => void;
}

/** Frames go on so long after the last thing that may need one. */
const LINGER_MS = 250;
/** Who clicks is taken there in so long. */
const FLIGHT_MS = 700;
/** A press that moves farther turns the view, pixels. */
const CLICK_PX = 5;
/** After a landing the eye is so far from its middle, of the radius. */
const VIEW_SHARE = 0.9;
/** A link may be down for so long before whoever waits for a landing is told. */
const LINK_PATIENCE_MS = 15_000;
const MAX_PIXEL_RATIO = 2;
const FOV_DEG = 55;

/** See the head of the file. Throws where the browser has no WebGL 2. */
export class ShownScene {
  readonly camera = new PerspectiveCamera(FOV_DEG, 1, 0.1, 4000);
  readonly stage: Stage;
  readonly #options: ShownSceneOptions;
  readonly #listeners: ShownSceneListeners;
  readonly #renderer: WebGLRenderer;
  readonly #scene = new Scene();
  readonly #controls: OrbitControls;
  readonly #stream: Stream;
  readonly #abort = new AbortController();
  #waiting: Waiting | null = null;
  /** The landing that was last told as shown whole. */
  #told: number | null = null;
  #link: LinkState | null = null;
  #patience: number | null = null;
  #flight: {
    readonly from: readonly [Vector3, Vector3];
    readonly to: readonly [Vector3, Vector3];
    startMs: number;
  } | null = null;
  /** Where the camera goes when the newest landing is shown; null where it stays. */
  #goal: Vector3 | null = null;
  #frame: number | null = null;
  #wantedUntilMs = 0;
  #isSeen = true;
  #pressed: readonly [number, number] | null = null;

  constructor(options: ShownSceneOptions, listeners: ShownSceneListeners) {
    const { canvas, files, budgets, sceneUrl, token } = options;
    this.#options = options;
    this.#listeners = listeners;
    this.#renderer = new WebGLRenderer({ canvas, alpha: true, antialias: true });
    // What lies behind the ground is the page's.
    this.#renderer.setClearColor(new Color(0), 0);
    const shares = sharesOf(budgets, files);
    this.#stream = openStream({
      sceneUrl,
      ...(token === undefined ? {} : { token }),
      budgets: shares.budgets,
      cacheBytes: budgets.cacheBytes,
      diskBytes: budgets.diskBytes,
      creditBytes: budgets.creditBytes,
    });
    this.#stream.onEvent = (event) => this.#take(event);
    this.stage = new Stage({
      renderer: this.#renderer,
      stream: this.#stream,
      files,
      spareGpuBytes: shares.spareGpuBytes,
      maxGpuBytes: shares.maxGpuBytes,
    });
    this.#scene.add(this.stage.object);
    this.#controls = new OrbitControls(this.camera, canvas);
    this.#controls.zoomToCursor = true;
    this.#controls.maxPolarAngle = Math.PI * 0.55;
    this.#controls.minDistance = 0.5;
    this.#controls.addEventListener("change", () => this.draw());
    const pose = framing(files.manifest.bounds, FOV_DEG, canvas.clientWidth / Math.max(1, canvas.clientHeight));
    this.camera.position.set(...orbitEye(pose));
    this.#controls.target.set(...pose.target);
    this.#controls.update();
    this.#listen(canvas);
    this.resize();
  }

  /** Of a landing unless its caller says otherwise, metres. */
  get radiusM(): number {
    return this.#options.radiusM() ?? defaultRadiusM(this.#options.files.manifest, this.#options.budgets);
  }

  /**
   * Land. Resolves when it is shown whole; rejects where it is refused or superseded, or where the link is closed, or down
   * for 15 s.
   */
  land(
    position: Vec3,
    radiusM: number,
    options: LandOptions & { readonly goes?: boolean } = {},
  ): Promise<LandingStatus> {
    const { goes = true, ...landOptions } = options;
    return new Promise((resolve, reject) => {
      const coarseRadiusM = coarseRadiusOf(radiusM, this.#options.files.manifest);
      const landing = this.stage.land(position, radiusM, {
        ...waitingOf(radiusM, false),
        ...(coarseRadiusM !== undefined && { coarseRadiusM }),
        ...landOptions,
      });
      this.#waiting?.reject(
        new StreamError("superseded", `landing ${this.#waiting.landing} was superseded by ${landing}`),
      );
      this.#waiting = { landing, resolve, reject };
      this.#goal = goes ? new Vector3(...position) : null;
      this.#watchLink();
      this.#listeners.landing(this.stage.status);
      this.draw();
    });
  }

  /** Base and cover are here, where it was made of the overview. False where they belong to another version. */
  complete(files: SceneFiles): boolean {
    if (files.manifest.version !== this.#options.files.manifest.version) return false;
    this.stage.replaceFiles(files);
    this.draw();
    return true;
  }

  /** The canvas has another size. */
  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.#options.canvas;
    if (width === 0 || height === 0) return;
    this.#renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
    this.#renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    // At once: a canvas of another size is empty.
    this.#renderer.render(this.#scene, this.camera);
    this.draw();
  }

  /** Whether anybody can see it: what nobody sees is not drawn. */
  set isSeen(isSeen: boolean) {
    this.#isSeen = isSeen;
    if (isSeen) this.draw();
  }

  /** Something may have changed. */
  draw(): void {
    this.#wantedUntilMs = performance.now() + LINGER_MS;
    if (this.#frame === null && this.#isSeen) this.#frame = requestAnimationFrame((nowMs) => this.#draw(nowMs));
  }

  /** Free everything: the stream, the canvas's context. */
  dispose(): void {
    this.#abort.abort();
    if (this.#frame !== null) cancelAnimationFrame(this.#frame);
    if (this.#patience !== null) window.clearTimeout(this.#patience);
    this.#settle((waiting) => waiting.reject(new StreamError("closed", "the scene is not shown any more")));
    this.#stream.close();
    this.#controls.dispose();
    this.stage.dispose();
    this.#renderer.dispose();
    // Browsers allow a handful of contexts.
    this.#renderer.forceContextLoss();
  }

  #draw(nowMs: number): void {
    this.#frame = null;
    this.#fly(nowMs);
    this.#controls.update();
    // What is ready now is shown in this very frame.
    this.stage.update();
    const { phase } = this.stage.status;
    if (phase === "presentable" || phase === "degraded-presentable") this.#swap();
    this.#tellWhole();
    this.#renderer.render(this.#scene, this.camera);
    const isLanding = phase === "planning" || phase === "streaming";
    if (isLanding) this.#listeners.landing(this.stage.status);
    const isOn = this.stage.busy || this.#flight !== null || isLanding || nowMs < this.#wantedUntilMs;
    if (isOn && this.#isSeen) this.#frame = requestAnimationFrame((nextMs) => this.#draw(nextMs));
  }

  #swap(): void {
    const before = this.stage.status;
    if (this.stage.swap() === null) return;
    this.stage.markFresh();
    if (this.#goal !== null) this.#leave(this.#goal, before.radiusM);
    this.#goal = null;
    this.#listeners.landing(this.stage.status);
  }

  /** Tell of a landing that is shown whole, once, and not before the service's word: a return is shown earlier. */
  #tellWhole(): void {
    const { status } = this.stage;
    if (status.phase !== "shown" || status.readyMs === null || status.landing === this.#told) return;
    this.#told = status.landing;
    this.#settle((waiting) => waiting.resolve(status));
    this.#listeners.landed(status);
  }

  /** Begin the way to a place: the look is kept, from as far as shows the landing. */
  #leave(target: Vector3, radiusM: number): void {
    const away = this.camera.position.clone().sub(this.#controls.target);
    away.setLength(Math.min(away.length(), Math.max(2, radiusM * VIEW_SHARE)));
    const eye = target.clone().add(away);
    const ground = this.stage.groundAt(eye.x, eye.z, this.stage.bounds[4] + 1);
    if (ground !== null) eye.y = Math.max(eye.y, ground.position[1] + 1.7);
    const from = [this.camera.position.clone(), this.#controls.target.clone()] as const;
    const startMs = this.#options.isStill() ? Number.NEGATIVE_INFINITY : performance.now();
    this.#flight = { from, to: [eye, target], startMs };
  }

  #fly(nowMs: number): void {
    if (this.#flight === null) return;
    const { from, to, startMs } = this.#flight;
    const share = Math.min(1, Math.max(0, (nowMs - startMs) / FLIGHT_MS));
    const eased = share * share * (3 - 2 * share);
    this.camera.position.lerpVectors(from[0], to[0], eased);
    this.#controls.target.lerpVectors(from[1], to[1], eased);
    if (share === 1) this.#flight = null;
  }

  #take(event: StreamEvent): void {
    const neededBefore = this.stage.neededVersion;
    this.stage.handle(event);
    const { neededVersion } = this.stage;
    if (neededVersion !== null && neededVersion !== neededBefore) void this.#takeVersion(neededVersion);
    if (event.type === "link") {
      this.#link = event.link;
      this.#watchLink();
      this.#listeners.link(event.link);
    } else if (event.type === "refused" && event.landing !== null) {
      const { landing } = event;
      if (this.#waiting?.landing === landing) {
        this.#settle((waiting) => waiting.reject(new StreamError(event.code, event.message)));
      }
      this.#listeners.refused(event.code, event.message);
    }
    this.draw();
  }

  async #takeVersion(version: string): Promise<void> {
    try {
      this.stage.replaceFiles(await this.#options.loadFiles(version));
      this.draw();
    } catch (error) {
      if (this.#abort.signal.aborted) return;
      this.#listeners.refused("version", error instanceof Error ? error.message : String(error));
    }
  }

  /** Whoever waits for a landing is told when there is no link to bring it. */
  #watchLink(): void {
    const isDown = this.#link !== null && this.#link.state !== "open";
    if (!isDown || this.#waiting === null) {
      if (this.#patience !== null) window.clearTimeout(this.#patience);
      this.#patience = null;
      return;
    }
    if (this.#link?.state === "closed") {
      const { code, message } = this.#link;
      this.#settle((waiting) => waiting.reject(new StreamError(code, message)));
      return;
    }
    this.#patience ??= window.setTimeout(() => {
      this.#patience = null;
      this.#settle((waiting) =>
        waiting.reject(
          new StreamError("unreachable", `no link for ${LINK_PATIENCE_MS / 1000} s; the landing waits for it`),
        ),
      );
    }, LINK_PATIENCE_MS);
  }

  #settle(how: (waiting: Waiting) => void): void {
    const waiting = this.#waiting;
    this.#waiting = null;
    if (waiting !== null) how(waiting);
  }

  #listen(canvas: HTMLCanvasElement): void {
    const { signal } = this.#abort;
    canvas.addEventListener(
      "pointerdown",
      ({ clientX, clientY, isPrimary, button }) => {
        this.#flight = null;
        this.#pressed = isPrimary && button === 0 ? [clientX, clientY] : null;
      },
      { signal },
    );
    canvas.addEventListener(
      "pointerup",
      ({ clientX, clientY }) => {
        const pressed = this.#pressed;
        this.#pressed = null;
        if (pressed === null || Math.hypot(clientX - pressed[0], clientY - pressed[1]) > CLICK_PX) return;
        this.#click(clientX, clientY);
      },
      { signal },
    );
    canvas.addEventListener(
      "webglcontextlost",
      (event) => {
        event.preventDefault();
        this.stage.contextLost();
      },
      { signal },
    );
    canvas.addEventListener(
      "webglcontextrestored",
      () => {
        this.stage.contextRestored();
        this.draw();
      },
      { signal },
    );
  }

  #click(clientX: number, clientY: number): void {
    const box = this.#options.canvas.getBoundingClientRect();
    const ray = new Raycaster();
    ray.setFromCamera(
      new Vector2(((clientX - box.left) / box.width) * 2 - 1, 1 - ((clientY - box.top) / box.height) * 2),
      this.camera,
    );
    const { origin, direction } = ray.ray;
    const hit = this.stage.cast(
      [origin.x, origin.y, origin.z],
      [direction.x, direction.y, direction.z],
      this.camera.far,
    );
    if (hit === null) this.#listeners.missed();
    else this.land(hit.position, this.radiusM).catch(() => undefined); // It is told by the events.
  }
}
