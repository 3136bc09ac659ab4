/** The arc as a ribbon that turns its flat side to the head: lines of WebGL are one pixel wide, too thin before the eyes. */

import { BufferAttribute, BufferGeometry, Color, DynamicDrawUsage, Mesh, ShaderMaterial } from "three";
import type { Vec3 } from "../core/types.ts";

/** Half its width: so many metres, and more with the distance from the head. */
const HALF_WIDTH_M = 0.006;
const HALF_WIDTH_PER_M = 0.0022;

const FIRM = new Color(0x8fd3ff);
const INVALID = new Color(0xff8a3c);

const VERTEX = /* glsl */ `
attribute float along;
varying float vAlong;
void main() {
  vAlong = along;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// Broken where one cannot land: not by colour alone. Near the hand it fades out, so that it does not hang before the eyes.
const FRAGMENT = /* glsl */ `
uniform vec3 uColour;
uniform bool uBroken;
uniform float uFadeM;
varying float vAlong;
void main() {
  if (uBroken && fract(vAlong / 0.6) > 0.5) discard;
  gl_FragColor = vec4(uColour, 0.85 * smoothstep(0.125 * uFadeM, uFadeM, vAlong));
  #include <colorspace_fragment>
}`;

export interface Ribbon {
  readonly object: Mesh;
  /** Draw the first `count` points (x, y, z each), seen from `eye`. */
  draw(points: Float32Array, count: number, eye: Vec3, firm: boolean): void;
  hide(): void;
  dispose(): void;
}

/**
 * A ribbon for at most `maxPoints` points, hidden. `order`: three.js's order of drawing; `fadeM`: it is wholly seen so far from its
 * beginning.
 */
export function createRibbon(maxPoints: number, order = 802, fadeM = 0.8): Ribbon {
  const geometry = new BufferGeometry();
  const positions = new BufferAttribute(new Float32Array(maxPoints * 6), 3).setUsage(DynamicDrawUsage);
  const along = new BufferAttribute(new Float32Array(maxPoints * 2), 1).setUsage(DynamicDrawUsage);
  const indices: number[] = [];
  for (let k = 0; k + 1 < maxPoints; k++) {
    indices.push(2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 2, 2 * k + 1, 2 * k + 3);
  }
  geometry.setAttribute("position", positions);
  geometry.setAttribute("along", along);
  geometry.setIndex(indices);
  const uniforms = { uColour: { value: FIRM.clone() }, uBroken: { value: false }, uFadeM: { value: fadeM } };
  const material = new ShaderMaterial({
    uniforms,
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthWrite: false,
    side: 2,
  });
  const object = new Mesh(geometry, material);
  object.name = "teleport-arc";
  // Its points change in every frame: a bounding sphere would cost more than it saves.
  object.frustumCulled = false;
  object.renderOrder = order;
  object.visible = false;
  return {
    object,
    draw(points, count, eye, firm) {
      fillRibbon(positions.array as Float32Array, along.array as Float32Array, points, count, eye);
      positions.needsUpdate = true;
      along.needsUpdate = true;
      geometry.setDrawRange(0, Math.max(0, count - 1) * 6);
      uniforms.uColour.value.copy(firm ? FIRM : INVALID);
      uniforms.uBroken.value = !firm;
      object.visible = count > 1;
    },
    hide() {
      object.visible = false;
    },
    dispose() {
      geometry.dispose();
      material.dispose();
    },
  };
}

/** Two places for every point, on both sides of it, and the length up to it. */
function fillRibbon(out: Float32Array, along: Float32Array, points: Float32Array, count: number, eye: Vec3): void {
  let lengthM = 0;
  for (let k = 0; k < count; k++) {
    const before = 3 * Math.max(0, k - 1);
    const after = 3 * Math.min(count - 1, k + 1);
    const x = points[3 * k]!;
    const y = points[3 * k + 1]!;
    const z = points[3 * k + 2]!;
    const alongX = points[after]! - points[before]!;
    const alongY = points[after + 1]! - points[before + 1]!;
    const alongZ = points[after + 2]! - points[before + 2]!;
    const eyeX = eye[0] - x;
    const eyeY = eye[1] - y;
    const eyeZ = eye[2] - z;
    // Across the line and across the view: the flat side faces the eye.
    const sideX = alongY * eyeZ - alongZ * eyeY;
    const sideY = alongZ * eyeX - alongX * eyeZ;
    const sideZ = alongX * eyeY - alongY * eyeX;
    const half = HALF_WIDTH_M + HALF_WIDTH_PER_M * Math.hypot(eyeX, eyeY, eyeZ);
    const scale = half / Math.max(1e-9, Math.hypot(sideX, sideY, sideZ));
    out[6 * k] = x + sideX * scale;
    out[6 * k + 1] = y + sideY * scale;
    out[6 * k + 2] = z + sideZ * scale;
    out[6 * k + 3] = x - sideX * scale;
    out[6 * k + 4] = y - sideY * scale;
    out[6 * k + 5] = z - sideZ * scale;
    if (k > 0) {
      lengthM += Math.hypot(x - points[3 * k - 3]!, y - points[3 * k - 2]!, z - points[3 * k - 1]!);
    }
    along[2 * k] = lengthM;
    along[2 * k + 1] = lengthM;
  }
}
