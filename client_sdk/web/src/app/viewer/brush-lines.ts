/** Strokes as they lie on the ground, drawn as wide as they are. */

import { Group } from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";

import type { Vec3 } from "../../core/types.ts";

/** A stroke with its places on the ground. */
export interface DrawnStroke {
  readonly colour: string;
  readonly widthM: number;
  readonly points: readonly Vec3[];
}

/** Owns its geometries and materials; `dispose` frees them. */
export interface BrushLines {
  readonly object: Group;
  set(strokes: readonly DrawnStroke[]): void;
  resize(width: number, height: number): void;
  dispose(): void;
}

const OPACITY = 0.85;
/** Above the ground, or half of the line would lie in it. */
const LIFT_M = 0.2;

/** Make them, empty. */
export function createBrushLines(): BrushLines {
  const object = new Group();
  let materials: LineMaterial[] = [];
  let geometries: LineGeometry[] = [];
  let [viewWidth, viewHeight] = [1, 1];

  function clear(): void {
    object.clear();
    for (const part of [...materials, ...geometries]) part.dispose();
    materials = [];
    geometries = [];
  }

  return {
    object,
    set(strokes) {
      clear();
      for (const { colour, widthM, points } of strokes) {
        if (points.length < 2) continue;
        const geometry = new LineGeometry();
        geometry.setPositions(points.flatMap(([x, y, z]) => [x, y + LIFT_M, z]));
        // Without a depth test: ground that is coarser than the stroke would hide parts of it.
        const material = new LineMaterial({
          color: Number.parseInt(colour.slice(1), 16),
          linewidth: widthM,
          worldUnits: true,
          opacity: OPACITY,
          transparent: true,
          depthTest: false,
          depthWrite: false,
        });
        material.resolution.set(viewWidth, viewHeight);
        const line = new Line2(geometry, material);
        line.renderOrder = 9;
        line.frustumCulled = false;
        object.add(line);
        materials.push(material);
        geometries.push(geometry);
      }
    },
    resize(width, height) {
      [viewWidth, viewHeight] = [width, height];
      for (const material of materials) material.resolution.set(width, height);
    },
    dispose: clear,
  };
}
