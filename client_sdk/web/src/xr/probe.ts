/** A straight ray at the ground, for what is picked and measured: no arc, since nobody walks there. */

import { Mesh, MeshBasicMaterial, type Object3D, SphereGeometry } from "three";
import type { Vec3 } from "../core/types.ts";
import type { Landings } from "../three/types.ts";
import { isHand, type Pointer } from "./inputs.ts";
import { createRibbon } from "./ribbon.ts";
import { BEFORE_MS, clearTrail, newTrail, noteTarget, targetBefore } from "./steady.ts";

/** As far as there can be ground, metres. */
const SIGHT_M = 1e6;
/** Where nothing is met the ray is drawn so far. */
const NOTHING_M = 30;
/** The dot at its end: this part of its distance, half a degree. */
const DOT_PER_M = 0.0045;

export interface Ray {
  readonly origin: Vec3;
  readonly direction: Vec3;
}

export interface Probe {
  readonly objects: readonly Object3D[];
  begin(): void;
  /** Once a frame while somebody points: one cast. */
  update(pointer: Pointer, eye: Vec3, nowMs: number): void;
  /** The ray of letting go now; null where it meets nothing. */
  ray(pointer: Pointer, nowMs: number): Ray | null;
  hide(): void;
  dispose(): void;
}

/** A probe, hidden; what is drawn is its own, freed by `dispose`. */
export function createProbe(landings: Pick<Landings, "cast">): Probe {
  const ribbon = createRibbon(2);
  const ends = new Float32Array(6);
  const geometry = new SphereGeometry(1, 16, 12);
  const material = new MeshBasicMaterial({ color: 0x8fd3ff, fog: false, depthTest: false, transparent: true });
  const dot = new Mesh(geometry, material);
  dot.renderOrder = 803;
  dot.visible = false;
  const trail = newTrail();
  const hide = (): void => {
    ribbon.hide();
    dot.visible = false;
  };
  return {
    objects: [ribbon.object, dot],
    begin: () => clearTrail(trail),
    update({ origin, direction }, eye, nowMs) {
      const hit = landings.cast(origin, direction, SIGHT_M);
      noteTarget(trail, nowMs, hit?.position ?? null);
      ends.set(origin, 0);
      for (let axis = 0; axis < 3; axis++) {
        ends[3 + axis] = hit?.position[axis] ?? origin[axis]! + NOTHING_M * direction[axis]!;
      }
      ribbon.draw(ends, 2, eye, hit !== null);
      dot.visible = hit !== null;
      if (hit === null) return;
      const [x, y, z] = hit.position;
      dot.position.set(x, y, z);
      dot.scale.setScalar(DOT_PER_M * Math.max(1, Math.hypot(x - eye[0], y - eye[1], z - eye[2])));
    },
    ray({ origin, source }, nowMs) {
      // A pinch moves the hand before it is recognised.
      const target = targetBefore(trail, nowMs, isHand(source) ? BEFORE_MS : 0);
      if (target === null) return null;
      return { origin: [...origin], direction: [target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]] };
    },
    hide,
    dispose() {
      ribbon.dispose();
      geometry.dispose();
      material.dispose();
    },
  };
}
