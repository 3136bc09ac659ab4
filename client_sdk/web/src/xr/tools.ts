/** What a trigger does besides landing by an arc: pick, measure, and land by the overview; and what of that is drawn. */

import type { Object3D } from "three";
import type { Vec3 } from "../core/types.ts";
import { standNear } from "../three/footing.ts";
import type { Landings } from "../three/types.ts";
import type { Pointer } from "./inputs.ts";
import { createMarks } from "./marks.ts";
import { createOverview } from "./overview.ts";
import { createProbe } from "./probe.ts";
import type { HeadsetOptions } from "./types.ts";

export interface ToolDesk {
  readonly objects: readonly Object3D[];
  /** Whether the gesture that began last points at what is picked or measured. */
  readonly probes: boolean;
  readonly overviewOpen: boolean;
  /** Somebody holds a place of the overview. */
  readonly held: boolean;
  openOverview(eye: Vec3, facingRad: number): void;
  closeOverview(): void;
  follow(eye: Vec3, facingRad: number): void;
  /** A press: true where it fell on the overview. */
  press(pointer: Pointer): boolean;
  /** A press was let go; true where it was the overview's. */
  release(pointer: Pointer): boolean;
  cancel(key: number | null): void;
  /** A gesture begins: true where the tool is not landing. */
  begin(): boolean;
  aim(pointer: Pointer, eye: Vec3, nowMs: number): void;
  /** The gesture ends: pick or measure. */
  use(pointer: Pointer, nowMs: number): void;
  hideProbe(): void;
  /** Once a frame. */
  update(pointers: readonly Pointer[], eye: Vec3, stood: Vec3, facingRad: number): void;
  dispose(): void;
}

/** What the tools set off. */
export interface ToolEffects {
  /** Land where one can stand. */
  readonly land: (place: Vec3) => void;
  readonly say: (text: string) => void;
}

/** Tools with nothing shown. Everything drawn is theirs, freed by `dispose`. */
export function createToolDesk(
  options: Pick<HeadsetOptions, "tools" | "setMiniature" | "radiusM">,
  landings: Landings,
  { land, say }: ToolEffects,
): ToolDesk {
  const { tools } = options;
  const probe = createProbe(landings);
  const marks = createMarks();
  const overview = createOverview(landings, options.radiusM, (pose) => options.setMiniature?.(pose));
  let probes = false;
  return {
    objects: [...probe.objects, ...marks.objects, ...overview.objects],
    get probes() {
      return probes;
    },
    get overviewOpen() {
      return overview.open;
    },
    get held() {
      return overview.held;
    },
    openOverview: overview.show,
    closeOverview: overview.hide,
    follow: overview.follow,
    press: overview.press,
    release(pointer) {
      const wasHeld = overview.held;
      const hit = overview.release(pointer);
      const wasOurs = wasHeld && !overview.held;
      if (hit === null) return wasOurs;
      const stand = standNear(hit, landings);
      if (stand === null) say("Nobody could stand there. Point beside it.");
      else land(stand);
      return true;
    },
    cancel: overview.cancel,
    begin() {
      probes = (tools?.tool() ?? "land") !== "land";
      if (probes) probe.begin();
      return probes;
    },
    aim: probe.update,
    use(pointer, nowMs) {
      const ray = probe.ray(pointer, nowMs);
      probe.hide();
      if (ray === null) say("There is no ground there.");
      else tools?.use(ray.origin, ray.direction);
    },
    hideProbe: probe.hide,
    update(pointers, eye, stood, facingRad) {
      overview.update(pointers, eye, stood, facingRad);
      // Labels stand at their places and may lie over each other: that of the tool in hand is read.
      const tool = tools?.tool();
      marks.update(
        tool === "measure" ? null : (tools?.picked() ?? null),
        tool === "pick" ? null : (tools?.measured() ?? null),
        eye,
      );
    },
    dispose() {
      probe.dispose();
      marks.dispose();
      overview.dispose();
    },
  };
}
