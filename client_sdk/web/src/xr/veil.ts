/** The veil before both eyes: black for a blink, a soft-edged opening for the comfort vignette. */

import { Mesh, PlaneGeometry, ShaderMaterial } from "three";

// The quad fills each eye's view. The opening is round in *angle*, not in pixels: the two eyes have lopsided frusta, and a
// circle about the middle of each picture would not be the same circle for both.
const VERTEX = /* glsl */ `
varying vec2 vTan;
void main() {
  gl_Position = vec4(position.xy, 0.0, 1.0);
  vTan = (position.xy + vec2(projectionMatrix[2][0], projectionMatrix[2][1]))
    / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
}`;

const FRAGMENT = /* glsl */ `
uniform float uFade;
uniform float uVignette;
varying vec2 vTan;
void main() {
  float angle = atan(length(vTan));
  float edge = mix(1.2, 0.38, uVignette);
  float rim = smoothstep(edge, edge + 0.25, angle) * step(0.001, uVignette);
  gl_FragColor = vec4(0.0, 0.0, 0.0, max(uFade, rim));
}`;

export interface Veil {
  readonly object: Mesh;
  /** Both 0 to 1: how black the view is, how far the vignette is closed. */
  set(fade: number, vignette: number): void;
  dispose(): void;
}

/** A veil, open. */
export function createVeil(): Veil {
  const uniforms = { uFade: { value: 0 }, uVignette: { value: 0 } };
  const material = new ShaderMaterial({
    uniforms,
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthTest: false,
    depthWrite: false,
  });
  const geometry = new PlaneGeometry(2, 2);
  const object = new Mesh(geometry, material);
  object.name = "veil";
  object.frustumCulled = false;
  // After everything else that is transparent.
  object.renderOrder = 1000;
  object.visible = false;
  return {
    object,
    set(fade, vignette) {
      uniforms.uFade.value = fade;
      uniforms.uVignette.value = vignette;
      object.visible = fade > 0 || vignette > 0;
    },
    dispose() {
      geometry.dispose();
      material.dispose();
    },
  };
}
