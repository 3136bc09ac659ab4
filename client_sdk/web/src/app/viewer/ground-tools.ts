/** What a click on the ground does: aim and land, pick, or measure. */

import type { Stream, Vec3 } from "../../core/types.ts";
import type { GroundHit } from "../../three/types.ts";
import { formatMetres } from "../format.ts";
import type { Ray } from "./camera-desk.ts";
import type { ViewerStore } from "./state.ts";

/** How the tools see the ground, and what they set off. */
export interface GroundToolOptions {
  readonly store: ViewerStore;
  readonly stream: Pick<Stream, "pick">;
  rayAt(x: number, y: number): Ray;
  cast(ray: Ray): GroundHit | null;
  /** Where one can stand near what was hit; null where nobody could. */
  standNear(hit: GroundHit): Vec3 | null;
  pixelOf(position: Vec3): { readonly x: number; readonly y: number } | null;
  aim(position: Vec3): void;
  cancelAim(): void;
  /** Land there, and go there. */
  land(position: Vec3): void;
  announce(text: string): void;
  /** A click met nothing, or asked a walker to a place where nobody could stand; null takes that back. */
  refuse(reason: "nothing" | "steep" | null): void;
}

/** What gestures on the ground do under the chosen tool. Points are CSS pixels of the canvas. */
export interface GroundTools {
  tap(x: number, y: number): void;
  /** Aim, where the tool lands; else as a tap. */
  aimAt(x: number, y: number): void;
  press(x: number, y: number): boolean;
  pressEnd(cancelled: boolean): void;
  undoPoint(): void;
  /** Pick or measure along a ray, as the tool is; as `tap` for who points by hand. */
  useRay(ray: Ray): void;
}

/** A click so near the target means the target. */
const TARGET_PX = 28;

/** A target so far from the click is explained. */
const BESIDE_M = 1;

/** So far before the ground the ray of a pick begins: the service asks full detail, which may lie before the base. */
const PICK_START_M = 15;

/** The tool is read from the store at every gesture, so that it may change in the middle of one. */
export function createGroundTools(options: GroundToolOptions): GroundTools {
  const { store, stream, rayAt, cast, standNear, pixelOf, aim, cancelAim, land, announce, refuse } = options;
  let pickNumber = 0;

  function isOnTarget(x: number, y: number): boolean {
    const target = store.get().aim;
    const pixel = target === null ? null : pixelOf(target.place);
    return pixel !== null && Math.hypot(pixel.x - x, pixel.y - y) <= TARGET_PX;
  }

  async function pick(ray: Ray, hit: GroundHit): Promise<void> {
    pickNumber += 1;
    const number = pickNumber;
    const { position, segment, region } = hit;
    store.set({ picked: { place: position, segment, region, answer: null }, tab: "inspect", panelOpen: true });
    // The page's own answer is shown at once; the service's, of full detail, replaces it.
    const startM = Math.max(0, hit.distanceM - PICK_START_M);
    const origin: Vec3 = [
      ray.origin[0] + ray.direction[0] * startM,
      ray.origin[1] + ray.direction[1] * startM,
      ray.origin[2] + ray.direction[2] * startM,
    ];
    const answer = await stream.pick(origin, ray.direction).catch(() => "failed" as const);
    // Only the newest is shown, however they come.
    if (number !== pickNumber) return;
    store.set({ picked: { place: position, segment, region, answer: answer ?? "none" } });
    if (typeof answer === "object" && answer !== null) announce(`Picked ${answer.label ?? `region ${answer.region}`}`);
  }

  function hitAt(x: number, y: number): { readonly ray: Ray; readonly hit: GroundHit } | null {
    const ray = rayAt(x, y);
    const hit = cast(ray);
    refuse(hit === null ? "nothing" : null);
    return hit === null ? null : { ray, hit };
  }

  /**
   * Where a landing at what was hit would be: where one can stand, also for who looks from above, since he may come down
   * there. A wall without a foothold can be looked at, not walked.
   */
  function targetOf(hit: GroundHit): Vec3 | null {
    const foothold = standNear(hit) ?? (store.get().view === "walk" ? null : hit.position);
    if (foothold === null) refuse("steep");
    return foothold;
  }

  function use(hit: GroundHit, go: (position: Vec3) => void): boolean {
    const foothold = targetOf(hit);
    if (foothold === null) return false;
    go(foothold);
    const besideM = distance(foothold, hit.position);
    if (besideM > BESIDE_M) announce(`Nobody could stand there. The target is ${formatMetres(besideM)} beside`);
    return true;
  }

  function inspect(ray: Ray, hit: GroundHit): void {
    const { tool, measured } = store.get();
    if (tool === "pick") void pick(ray, hit);
    else if (tool === "measure") store.set({ measured: [...measured, hit.position], tab: "inspect" });
  }

  function tap(x: number, y: number): void {
    // On the target's own mark, whatever the ray behind it meets: it is what the user sees under the finger.
    const { tool, aim: target } = store.get();
    if (tool === "land" && target !== null && isOnTarget(x, y)) {
      land(target.place);
      return;
    }
    const rayHit = hitAt(x, y);
    if (rayHit === null) return;
    if (tool === "land") use(rayHit.hit, land);
    else inspect(rayHit.ray, rayHit.hit);
  }

  function aimAt(x: number, y: number): boolean {
    const rayHit = hitAt(x, y);
    return rayHit !== null && use(rayHit.hit, aim);
  }

  return {
    tap,
    useRay(ray) {
      const hit = cast(ray);
      if (hit !== null) inspect(ray, hit);
    },
    aimAt(x, y) {
      if (store.get().tool === "land") aimAt(x, y);
      else tap(x, y);
    },
    press: (x, y) => store.get().tool === "land" && aimAt(x, y),
    pressEnd(cancelled) {
      const { aim: target } = store.get();
      if (cancelled) cancelAim();
      else if (target !== null) land(target.place);
    },
    undoPoint() {
      const { measured } = store.get();
      if (measured.length > 0) store.set({ measured: measured.slice(0, -1) });
    },
  };
}

function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
