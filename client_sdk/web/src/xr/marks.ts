/** What was picked and measured, in the world: a label that stands at its place, the line of a measurement. */

import { Mesh, MeshBasicMaterial, type Object3D, SphereGeometry } from "three";
import type { Vec3 } from "../core/types.ts";
import { createPanel, drawPlate, FONT, METRES_PER_UNIT } from "./panel.ts";
import { createRibbon } from "./ribbon.ts";
import type { HeadsetMark } from "./types.ts";

const WIDTH = 1000;
const LINE = 84;
const TOP = 60;
/** Of a label: a title and eight lines. */
const MAX_LINES = 9;
const HEIGHT = TOP + MAX_LINES * LINE;
/** A label is as large in the eye as one at this distance, metres, wherever its place is. */
export const LABEL_AS_AT_M = 1;
export const LABEL_FONT = 60;
/** Nearer than this it stays as small as it is there. */
const LEAST_M = 0.6;
/** It stands so high over its place, as a part of its distance: beside the ray that made it. */
const OVER = 0.03;
/** Points of a measured path that are drawn: its newest. */
const MAX_POINTS = 64;
const DOT_PER_M = 0.006;
/** A path is no ray of a hand: it is seen from its first point on. */
const PATH_FADE_M = 0.01;

export interface Marks {
  readonly objects: readonly Object3D[];
  /** Once a frame: labels turn to the eye and stay readable. Drawn anew only where a mark is another object than before. */
  update(picked: HeadsetMark | null, measured: HeadsetMark | null, eye: Vec3): void;
  dispose(): void;
}

/** Labels and line, hidden; all of it is its own, freed by `dispose`. */
export function createMarks(): Marks {
  const picked = createLabel("picked-label", "#8fd3ff");
  const measured = createLabel("measured-label", "#ff7ac1");
  const path = createRibbon(MAX_POINTS, 804, PATH_FADE_M);
  const points = new Float32Array(3 * MAX_POINTS);
  return {
    objects: [...picked.objects, ...measured.objects, path.object],
    update(pickedMark, measuredMark, eye) {
      picked.update(pickedMark, eye);
      measured.update(measuredMark, eye);
      const shown = measuredMark?.points.slice(-MAX_POINTS) ?? [];
      if (shown.length < 2) {
        path.hide();
        return;
      }
      shown.forEach((point, k) => {
        points.set(point, 3 * k);
      });
      path.draw(points, shown.length, eye, true);
    },
    dispose() {
      picked.dispose();
      measured.dispose();
      path.dispose();
    },
  };
}

interface Label {
  readonly objects: readonly Object3D[];
  update(mark: HeadsetMark | null, eye: Vec3): void;
  dispose(): void;
}

function createLabel(name: string, edge: string): Label {
  const panel = createPanel(name, WIDTH, HEIGHT);
  const geometry = new SphereGeometry(1, 16, 12);
  const material = new MeshBasicMaterial({ color: edge, fog: false, depthTest: false, transparent: true });
  const dot = new Mesh(geometry, material);
  dot.renderOrder = 805;
  dot.visible = false;
  let drawn: HeadsetMark | null = null;
  let heightUnits = HEIGHT;
  return {
    objects: [panel.object, dot],
    update(mark, eye) {
      const place = mark?.points.at(-1);
      dot.visible = place !== undefined;
      if (mark === null || place === undefined) {
        panel.hide();
        drawn = null;
        return;
      }
      if (mark !== drawn) {
        drawn = mark;
        const lines = mark.lines.slice(0, MAX_LINES);
        heightUnits = TOP + lines.length * LINE;
        panel.draw((context) => drawLabel(context, lines, heightUnits, edge));
      }
      const [x, y, z] = place;
      const [dx, dy, dz] = [eye[0] - x, eye[1] - y, eye[2] - z];
      const awayM = Math.max(LEAST_M, Math.hypot(dx, dy, dz));
      const scale = awayM / LABEL_AS_AT_M;
      // The plate is drawn at the canvas's bottom, so that its lower edge stands over the place whatever it says.
      const upM = (HEIGHT / 2) * METRES_PER_UNIT * scale + OVER * awayM;
      panel.object.scale.setScalar(scale);
      panel.moveTo({
        centre: [x, y + upM, z],
        yawRad: Math.atan2(dx, dz),
        leanRad: Math.atan2(dy - upM, Math.hypot(dx, dz)),
      });
      dot.position.set(x, y, z);
      dot.scale.setScalar(DOT_PER_M * awayM);
    },
    dispose() {
      panel.dispose();
      geometry.dispose();
      material.dispose();
    },
  };
}

function drawLabel(context: CanvasRenderingContext2D, lines: readonly string[], height: number, edge: string): void {
  const top = HEIGHT - height;
  context.save();
  context.translate(0, top);
  drawPlate(context, WIDTH, height, "rgba(16, 20, 26, 0.9)", edge);
  context.textBaseline = "middle";
  context.textAlign = "left";
  for (const [k, line] of lines.entries()) {
    context.fillStyle = k === 0 ? edge : "#f2f5f8";
    context.font = `${k === 0 ? 700 : 500} ${LABEL_FONT}px ${FONT}`;
    context.fillText(line, 44, TOP / 2 + (k + 0.5) * LINE, WIDTH - 88);
  }
  context.restore();
}
