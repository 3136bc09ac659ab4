/** What a click on the ground does: aim and land, pick, or measure. */

import type { Stream, Vec3 } from "../../core/types.ts";
import type { GroundHit } from "../../three/types.ts";
import type { Ray } from "./camera-desk.ts";
import type { ViewerStore } from "./state.ts";

/** What the tools need. */
export interface GroundToolOptions {
  readonly store: ViewerStore;
  readonly stream: Pick<Stream, "pick">;
  rayAt(x: number, y: number): Ray;
  cast(ray: Ray): GroundHit | null;
  pixelOf(place: Vec3): { readonly x: number; readonly y: number } | null;
  aim(place: Vec3): void;
  land(place: Vec3): void;
  say(text: string): void;
}

/** The tools. Places are CSS pixels of the canvas. */
export interface GroundTools {
  tap(x: number, y: number): void;
  press(x: number, y: number): boolean;
  pressMove(x: number, y: number): void;
  pressEnd(cancelled: boolean): void;
  undoPoint(): void;
}

/** A click so near the target means the target. */
const TARGET_PX = 28;

/** So far before the ground the ray of a pick begins: the service asks full detail, which may lie before the base. */
const PICK_START_M = 15;

/** Make them. */
export function createGroundTools(options: GroundToolOptions): GroundTools {
  const { store, stream, rayAt, cast, pixelOf, aim, land, say } = options;
  let pickNumber = 0;

  function isOnTarget(x: number, y: number): boolean {
    const target = store.get().aim;
    const pixel = target === null ? null : pixelOf(target.place);
    return pixel !== null && Math.hypot(pixel.x - x, pixel.y - y) <= TARGET_PX;
  }

  async function pick(ray: Ray, hit: GroundHit): Promise<void> {
    pickNumber += 1;
    const number = pickNumber;
    const { position: place, segment, region } = hit;
    store.set({ picked: { place, segment, region, answer: null }, tab: "inspect", panelOpen: true });
    const startM = Math.max(0, hit.distanceM - PICK_START_M);
    const origin: Vec3 = [
      ray.origin[0] + ray.direction[0] * startM,
      ray.origin[1] + ray.direction[1] * startM,
      ray.origin[2] + ray.direction[2] * startM,
    ];
    const answer = await stream.pick(origin, ray.direction).catch(() => "failed" as const);
    // Only the newest is shown, however they come.
    if (number !== pickNumber) return;
    store.set({ picked: { place, segment, region, answer: answer ?? "none" } });
    if (typeof answer === "object" && answer !== null) say(`Picked ${answer.label ?? `region ${answer.region}`}`);
  }

  function hitAt(x: number, y: number): { readonly ray: Ray; readonly hit: GroundHit } | null {
    const ray = rayAt(x, y);
    const hit = cast(ray);
    return hit === null ? null : { ray, hit };
  }

  return {
    tap(x, y) {
      const { tool, aim: target, measured } = store.get();
      if (tool === "land" && target !== null && isOnTarget(x, y)) {
        land(target.place);
        return;
      }
      const found = hitAt(x, y);
      if (found === null) {
        say("There is no ground");
        return;
      }
      if (tool === "land") aim(found.hit.position);
      else if (tool === "pick") void pick(found.ray, found.hit);
      else store.set({ measured: [...measured, found.hit.position], tab: "inspect" });
    },
    press(x, y) {
      if (store.get().tool !== "land") return false;
      const found = hitAt(x, y);
      if (found === null) return false;
      aim(found.hit.position);
      return true;
    },
    pressMove(x, y) {
      const found = hitAt(x, y);
      if (found !== null) aim(found.hit.position);
    },
    pressEnd(cancelled) {
      const { aim: target } = store.get();
      if (!cancelled && target !== null) land(target.place);
    },
    undoPoint() {
      const { measured } = store.get();
      if (measured.length > 0) store.set({ measured: measured.slice(0, -1) });
    },
  };
}
