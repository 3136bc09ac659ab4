/**
 * The sky in the headset. On a screen the page's own background shows behind the canvas; before the eyes there is no page.
 *
 * A quiet gradient by the height of the line of sight: a level horizon, without anything that could be taken for scenery.
 */

import { Color, Mesh, PlaneGeometry, ShaderMaterial } from "three";

const VERTEX = /* glsl */ `
varying vec3 vAlong;
void main() {
  gl_Position = vec4(position.xy, 0.0, 1.0);
  vec3 inView = vec3(
    (position.xy + vec2(projectionMatrix[2][0], projectionMatrix[2][1]))
      / vec2(projectionMatrix[0][0], projectionMatrix[1][1]),
    -1.0);
  vAlong = transpose(mat3(viewMatrix)) * inView;
}`;

const FRAGMENT = /* glsl */ `
uniform vec3 uTop;
uniform vec3 uHorizon;
uniform vec3 uBelow;
varying vec3 vAlong;
void main() {
  float height = normalize(vAlong).y;
  vec3 colour = height > 0.0
    ? mix(uHorizon, uTop, pow(height, 0.6))
    : mix(uHorizon, uBelow, pow(-height, 0.4));
  gl_FragColor = vec4(colour, 1.0);
  #include <colorspace_fragment>
}`;

export interface Sky {
  readonly object: Mesh;
  dispose(): void;
}

/** A sky, light or dark as the page. */
export function createSky(dark: boolean): Sky {
  const material = new ShaderMaterial({
    uniforms: {
      uTop: { value: new Color(dark ? 0x0f1418 : 0x9fbdd3) },
      uHorizon: { value: new Color(dark ? 0x2a3136 : 0xe9edef) },
      uBelow: { value: new Color(dark ? 0x1b2024 : 0xb9b5ab) },
    },
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    depthTest: false,
    depthWrite: false,
  });
  const geometry = new PlaneGeometry(2, 2);
  const object = new Mesh(geometry, material);
  object.name = "headset-sky";
  object.frustumCulled = false;
  object.renderOrder = -1000;
  return {
    object,
    dispose() {
      geometry.dispose();
      material.dispose();
    },
  };
}
