/** A panel in the world: a canvas as texture on a plane that hangs where it was put. */

import {
  AlwaysDepth,
  CanvasTexture,
  LinearFilter,
  LinearMipmapLinearFilter,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  SRGBColorSpace,
} from "three";
import type { PanelPose } from "./panel-place.ts";

/** Capitals of 36 units are 13 mm high: a degree at three quarters of a metre. */
export const METRES_PER_UNIT = 0.0005;
export const FONT = "system-ui, sans-serif";

export interface Panel {
  readonly object: Mesh;
  /** Draw anew; `draw` gets a cleared canvas in panel units. One upload to the GPU: not for every frame. */
  draw(draw: (context: CanvasRenderingContext2D) => void): void;
  moveTo(pose: PanelPose): void;
  readonly pose: PanelPose | null;
  hide(): void;
  dispose(): void;
}

/**
 * A panel of so many units, hidden. Canvas, texture, geometry and material are its own; `dispose` frees them, and takes nothing
 * out of the scene.
 */
export function createPanel(name: string, width: number, height: number): Panel {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  // Seen at a slant and from further away, text without mipmaps shimmers with every movement of the head.
  texture.generateMipmaps = true;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.magFilter = LinearFilter;
  texture.anisotropy = 4;
  const material = new MeshBasicMaterial({
    map: texture,
    transparent: true,
    // Seen even where it hangs within a rock face; yet it leaves its depth, so that a hand before it is drawn before it.
    depthFunc: AlwaysDepth,
    alphaTest: 0.5,
    toneMapped: false,
    fog: false,
  });
  const geometry = new PlaneGeometry(width * METRES_PER_UNIT, height * METRES_PER_UNIT);
  const object = new Mesh(geometry, material);
  object.name = name;
  object.renderOrder = 900;
  object.rotation.order = "YXZ";
  object.visible = false;
  let pose: PanelPose | null = null;
  return {
    object,
    draw(draw) {
      if (context !== null) {
        context.clearRect(0, 0, width, height);
        draw(context);
        texture.needsUpdate = true;
      }
    },
    moveTo(next) {
      pose = next;
      object.position.set(next.centre[0], next.centre[1], next.centre[2]);
      object.rotation.set(-next.leanRad, next.yawRad, 0);
      object.visible = true;
    },
    get pose() {
      return object.visible ? pose : null;
    },
    hide() {
      object.visible = false;
    },
    dispose() {
      geometry.dispose();
      texture.dispose();
      material.dispose();
    },
  };
}

/** How high a font's capitals are in the eye, degrees, on a panel so far away; what is read is a degree at least. */
export function capitalsDeg(fontUnits: number, awayM: number): number {
  const capitalsM = 0.72 * fontUnits * METRES_PER_UNIT;
  return (Math.atan2(capitalsM, awayM) * 180) / Math.PI;
}

/** A rounded plate over the whole canvas. */
export function drawPlate(
  context: CanvasRenderingContext2D,
  width: number,
  height: number,
  fill: string,
  edge: string,
): void {
  context.beginPath();
  context.roundRect(3, 3, width - 6, height - 6, 36);
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 4;
  context.strokeStyle = edge;
  context.stroke();
}
