/** Camera, controls and frames of one canvas: drawn when something changes and somebody can see it. */

import { PerspectiveCamera, Raycaster, Scene, Vector2, type Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { framing, orbitEye } from "../three/orbit-pose.ts";
import type { Terrain, TerrainIntersection } from "../three/terrain.ts";

/** Drawing continues for this long after the last change. */
const LINGER_MS = 250;
/** Duration of the camera's way to a landing. */
const FLIGHT_MS = 700;
/** A press that moves farther than this turns the view, pixels. */
const CLICK_PX = 5;
/** Distance of the camera after a landing, as a share of the radius. */
const VIEW_SHARE = 0.9;
const EYE_HEIGHT_M = 1.7;
const MAX_PIXEL_RATIO = 2;
const FOV_DEG = 55;

/** A way of the camera: eye and target at its beginning and its end. */
interface Flight {
  readonly from: readonly [Vector3, Vector3];
  readonly to: readonly [Vector3, Vector3];
  readonly startMs: number;
}

/** A canvas that shows a terrain. Throws where the browser has no WebGL 2. */
export class SceneView {
  readonly canvas = document.createElement("canvas");
  readonly renderer: WebGLRenderer;
  readonly camera = new PerspectiveCamera(FOV_DEG, 1, 0.1, 4000);
  readonly #scene = new Scene();
  readonly #controls: OrbitControls;
  readonly #abort = new AbortController();
  #terrain: Terrain | null = null;
  #flight: Flight | null = null;
  #frame: number | null = null;
  #wantedUntilMs = 0;
  #isSeen = true;
  #pressed: readonly [number, number] | null = null;

  /** @param onClick - called with the ground that was clicked, or null where there is none. */
  constructor(onClick: (hit: TerrainIntersection | null) => void) {
    // What is behind the ground is the page's.
    this.renderer = new WebGLRenderer({ canvas: this.canvas, alpha: true, antialias: true });
    this.#controls = new OrbitControls(this.camera, this.canvas);
    this.#controls.zoomToCursor = true;
    this.#controls.maxPolarAngle = Math.PI * 0.55;
    this.#controls.minDistance = 0.5;
    this.#controls.addEventListener("change", () => this.draw());
    const { signal } = this.#abort;
    this.canvas.addEventListener(
      "pointerdown",
      ({ clientX, clientY, isPrimary, button }) => {
        this.#flight = null;
        this.#pressed = isPrimary && button === 0 ? [clientX, clientY] : null;
      },
      { signal },
    );
    this.canvas.addEventListener(
      "pointerup",
      ({ clientX, clientY }) => {
        const pressed = this.#pressed;
        this.#pressed = null;
        if (pressed === null || Math.hypot(clientX - pressed[0], clientY - pressed[1]) > CLICK_PX) return;
        onClick(this.#groundAt(clientX, clientY));
      },
      { signal },
    );
  }

  /** Show a terrain, all of it. */
  show(terrain: Terrain): void {
    this.#terrain = terrain;
    this.#scene.add(terrain);
    for (const type of ["stream", "replaced", "contextrestored"] as const) {
      terrain.addEventListener(type, () => this.draw());
    }
    const { clientWidth, clientHeight } = this.canvas;
    const pose = framing(terrain.bounds, FOV_DEG, clientWidth / Math.max(1, clientHeight));
    this.camera.position.set(...orbitEye(pose));
    this.#controls.target.set(...pose.target);
    this.#controls.update();
    this.resize();
  }

  /** The canvas has another size. */
  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    // At once: a canvas of another size is empty.
    this.renderer.render(this.#scene, this.camera);
    this.draw();
  }

  /** Whether anybody can see it: otherwise nothing is drawn. */
  set isSeen(isSeen: boolean) {
    this.#isSeen = isSeen;
    if (isSeen) this.draw();
  }

  /** Something may have changed. */
  draw(): void {
    this.#wantedUntilMs = performance.now() + LINGER_MS;
    if (this.#frame === null && this.#isSeen) this.#frame = requestAnimationFrame((nowMs) => this.#draw(nowMs));
  }

  /** Move the camera to a landing: it looks the same way, from as far as shows the landing. */
  flyTo(place: Vector3, radiusM: number): void {
    const terrain = this.#terrain;
    if (terrain === null) return;
    const away = this.camera.position.clone().sub(this.#controls.target);
    away.setLength(Math.min(away.length(), Math.max(2, radiusM * VIEW_SHARE)));
    const eye = place.clone().add(away);
    eye.y = Math.max(eye.y, (terrain.heightAt(eye.x, eye.z) ?? Number.NEGATIVE_INFINITY) + EYE_HEIGHT_M);
    const from = [this.camera.position.clone(), this.#controls.target.clone()] as const;
    const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.#flight = { from, to: [eye, place], startMs: isStill ? Number.NEGATIVE_INFINITY : performance.now() };
    this.draw();
  }

  dispose(): void {
    this.#abort.abort();
    if (this.#frame !== null) cancelAnimationFrame(this.#frame);
    this.#controls.dispose();
    this.canvas.remove();
    this.renderer.dispose();
    // Browsers allow a handful of contexts.
    this.renderer.forceContextLoss();
  }

  #draw(nowMs: number): void {
    this.#frame = null;
    this.#fly(nowMs);
    this.#controls.update();
    this.#terrain?.update();
    this.renderer.render(this.#scene, this.camera);
    const phase = this.#terrain?.status.phase;
    const isLanding = phase === "planning" || phase === "streaming";
    const isOn = this.#terrain?.busy === true || this.#flight !== null || isLanding || nowMs < this.#wantedUntilMs;
    if (isOn && this.#isSeen) this.#frame ??= requestAnimationFrame((nextMs) => this.#draw(nextMs));
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

  #groundAt(clientX: number, clientY: number): TerrainIntersection | null {
    if (this.#terrain === null) return null;
    const box = this.canvas.getBoundingClientRect();
    const raycaster = new Raycaster();
    const [x, y] = [(clientX - box.left) / box.width, (clientY - box.top) / box.height];
    raycaster.setFromCamera(new Vector2(2 * x - 1, 1 - 2 * y), this.camera);
    const [hit] = raycaster.intersectObject(this.#terrain) as TerrainIntersection[];
    return hit ?? null;
  }
}
