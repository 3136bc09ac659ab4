/**
 * The landing ring: lies on the ground where the arc comes down and shows whether one may land there.
 *
 * Meaning is carried by shape first, colour second: what waits for its payload has a second, inner ring, and an arc of the ring
 * fills clockwise as it comes; no landing is a broken ring with a cross.
 */

import { Color, CylinderGeometry, Group, Mesh, PlaneGeometry, Quaternion, ShaderMaterial, Vector3 } from "three";
import type { Vec3 } from "../core/types.ts";

/** `aim`: one may land. `waiting`: asked for. `invalid`: not here. */
export type RingState = "aim" | "waiting" | "invalid";

/** Radius, metres; farther away it grows, so that it is never smaller than 1.1 degrees. */
export const RING_RADIUS_M = 0.45;
const LEAST_ANGLE_RAD = 0.02;
const WALL_HEIGHT_M = 0.3;
/** The quad reaches so far beyond the ring, for the arrow. */
const MARGIN = 1.4;

// Light on dark rock and dark-edged on bright sand. Blue and orange differ for every kind of colour vision.
const COLOURS: Readonly<Record<RingState, Color>> = {
  aim: new Color(0x8fd3ff),
  waiting: new Color(0xffffff),
  invalid: new Color(0xff8a3c),
};
const CODES: Readonly<Record<RingState, number>> = { aim: 0, waiting: 1, invalid: 2 };

// Depth is taken from a little nearer to the eye, so pebbles under the ring do not eat it; its place is not changed, so both
// eyes still see it lying on the ground.
const NEARER = /* glsl */ `
vec4 nearer(vec4 inView) {
  vec4 clip = projectionMatrix * inView;
  float away = length(inView.xyz);
  float by = min(0.25 + 0.02 * away, 0.5 * away);
  vec4 shifted = projectionMatrix * vec4(inView.xyz * (1.0 - by / away), 1.0);
  clip.z = shifted.z / shifted.w * clip.w;
  return clip;
}`;

const FLAT_VERTEX = /* glsl */ `
varying vec2 vPlace;
${NEARER}
void main() {
  vPlace = vec2(position.x, -position.z);
  gl_Position = nearer(modelViewMatrix * vec4(position, 1.0));
}`;

const FLAT_FRAGMENT = /* glsl */ `
uniform vec3 uColour;
uniform int uState;
uniform float uFraction;
varying vec2 vPlace;
const float TAU = 6.2831853;
float band(float r, float inner, float outer) {
  float soft = fwidth(r);
  return smoothstep(inner - soft, inner + soft, r) * (1.0 - smoothstep(outer - soft, outer + soft, r));
}
void main() {
  float r = length(vPlace);
  float clockwise = mod(atan(vPlace.x, vPlace.y), TAU) / TAU;
  float ring = band(r, 0.82, 1.0);
  float dark = band(r, 0.76, 1.06) * 0.55;
  float lit = ring * step(clockwise, uFraction);
  float faint = ring * 0.3;
  if (uState == 1) {
    lit = max(lit, band(r, 0.52, 0.6));
    dark = max(dark, band(r, 0.47, 0.65) * 0.55);
  } else if (uState == 2) {
    float gaps = step(0.35, fract(clockwise * 12.0));
    vec2 q = abs(vec2(vPlace.x + vPlace.y, vPlace.x - vPlace.y)) * 0.7071;
    float arm = band(min(q.x, q.y), -1.0, 0.09) * band(r, -1.0, 0.6);
    float armDark = band(min(q.x, q.y), -1.0, 0.15) * band(r, -1.0, 0.66);
    lit = max(ring * gaps, arm);
    faint = 0.0;
    dark = max(dark * gaps, armDark * 0.55);
  }
  if (uState != 2) {
    float reach = (1.36 - vPlace.y) * 0.8;
    float soft = fwidth(vPlace.x);
    float arrow = step(1.12, vPlace.y) * (1.0 - smoothstep(reach - soft, reach + soft, abs(vPlace.x)));
    lit = max(lit, arrow);
  }
  float alpha = max(max(lit * 0.95, faint), dark);
  if (alpha < 0.01) discard;
  gl_FragColor = vec4(uColour * max(lit, faint) / max(alpha, 0.01), alpha);
  #include <colorspace_fragment>
}`;

const WALL_VERTEX = /* glsl */ `
varying float vHeight;
${NEARER}
void main() {
  vHeight = position.y;
  gl_Position = nearer(modelViewMatrix * vec4(position, 1.0));
}`;

const WALL_FRAGMENT = /* glsl */ `
uniform vec3 uColour;
varying float vHeight;
void main() {
  float fading = 1.0 - vHeight;
  gl_FragColor = vec4(uColour, 0.45 * fading * fading);
  #include <colorspace_fragment>
}`;

export interface Ring {
  readonly object: Group;
  /**
   * Lay it at `position` on ground with this upward unit normal, seen from `eye`; `facingRad` is where its arrow points.
   */
  lay(position: Vec3, normal: Vec3, eye: Vec3, facingRad: number): void;
  show(state: RingState, fraction: number): void;
  hide(): void;
  dispose(): void;
}

const UP = new Vector3(0, 1, 0);

/** A ring, hidden. Flat ring and wall share their uniforms: one call of `show` changes both. */
export function createRing(): Ring {
  const uniforms = {
    uColour: { value: COLOURS.aim.clone() },
    uState: { value: 0 },
    uFraction: { value: 0 },
  };
  const common = { uniforms, transparent: true, depthWrite: false, side: 2 as const };
  const flatMaterial = new ShaderMaterial({ ...common, vertexShader: FLAT_VERTEX, fragmentShader: FLAT_FRAGMENT });
  const wallMaterial = new ShaderMaterial({ ...common, vertexShader: WALL_VERTEX, fragmentShader: WALL_FRAGMENT });
  const flatGeometry = new PlaneGeometry(2 * MARGIN, 2 * MARGIN).rotateX(-Math.PI / 2);
  const wallGeometry = new CylinderGeometry(1, 1, 1, 48, 1, true).translate(0, 0.5, 0);
  const object = new Group();
  object.name = "landing-ring";
  const flat = new Mesh(flatGeometry, flatMaterial);
  const wall = new Mesh(wallGeometry, wallMaterial);
  flat.renderOrder = 800;
  wall.renderOrder = 801;
  object.add(flat, wall);
  object.visible = false;
  const up = new Vector3();
  const tilt = new Quaternion();
  const turn = new Quaternion();
  return {
    object,
    lay(position, normal, eye, facingRad) {
      const awayM = Math.hypot(position[0] - eye[0], position[1] - eye[1], position[2] - eye[2]);
      const radiusM = Math.max(RING_RADIUS_M, LEAST_ANGLE_RAD * awayM);
      object.position.set(position[0], position[1], position[2]);
      object.scale.set(radiusM, WALL_HEIGHT_M * (radiusM / RING_RADIUS_M), radiusM);
      tilt.setFromUnitVectors(UP, up.set(normal[0], normal[1], normal[2]));
      object.quaternion.copy(tilt).multiply(turn.setFromAxisAngle(UP, facingRad));
    },
    show(state, fraction) {
      uniforms.uColour.value.copy(COLOURS[state]);
      uniforms.uState.value = CODES[state];
      uniforms.uFraction.value = fraction;
      wall.visible = state !== "invalid";
      object.visible = true;
    },
    hide() {
      object.visible = false;
    },
    dispose() {
      flatGeometry.dispose();
      wallGeometry.dispose();
      flatMaterial.dispose();
      wallMaterial.dispose();
    },
  };
}
