/** How the ground takes part in the three.js scene around it: fog, lights, shadows, clipping planes, tone mapping. */

import { type Mesh, type Plane, ShaderMaterial, type ShaderMaterialParameters } from "three";

import { CASTER_SHADER } from "./ground-shader.ts";

/** What the ground takes part in; the words are those of three.js's materials and meshes. */
export interface Shading {
  /**
   * Lit by the scene's lights, as a `MeshLambertMaterial` of the ground's colours: ambient, hemisphere, directional, point and spot
   * lights, and light probes; no environment. Default false: a survey's colours have their light in them.
   */
  readonly lit?: boolean;
  /**
   * Whether the renderer's shadow maps fall on it. What is not `lit` is darkened by the share that a shadow takes of the scene's
   * lights there, so it needs some light from the sky, or shadows are black. Default false.
   */
  readonly receiveShadow?: boolean;
  /** Whether what is shown of it casts shadows. Default false. */
  readonly castShadow?: boolean;
  /** Whether the scene's `fog` veils it. Default true. */
  readonly fog?: boolean;
  /** Whether the renderer's tone mapping changes its colours. Default true. */
  readonly toneMapped?: boolean;
  /** Local planes, where the renderer has `localClippingEnabled`; its own `clippingPlanes` cut the ground in any case. */
  readonly clippingPlanes?: readonly Plane[] | null;
  /** Cut away only what all local planes cut. Default false. */
  readonly clipIntersection?: boolean;
  /** Cut the ground's shadows by the local planes too. Default false. */
  readonly clipShadows?: boolean;
}

/** Nothing of it costs anything as long as scene and renderer have none. */
const SHADING_DEFAULTS: Required<Shading> = {
  lit: false,
  receiveShadow: false,
  castShadow: false,
  fog: true,
  toneMapped: true,
  clippingPlanes: null,
  clipIntersection: false,
  clipShadows: false,
};

/** Drawn into shadow maps with its both sides, so a lit side would shade itself where the map is coarse: so far behind. */
const CASTER_OFFSET = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 4 };

/** A material of the ground's, and the one that stands for it in shadow maps. */
export class ShadedMaterial {
  readonly material: ShaderMaterial;
  readonly #parameters: ShaderMaterialParameters;
  readonly #own: readonly string[];
  readonly #name: string;
  #caster: ShaderMaterial | null = null;
  #shading = SHADING_DEFAULTS;
  #isCompared = false;

  /** @param own What its program always defines. */
  constructor(parameters: ShaderMaterialParameters, name: string, own: readonly string[]) {
    this.#parameters = parameters;
    this.#own = own;
    this.#name = name;
    // `clipping`: whatever planes there are, global ones too.
    this.material = new ShaderMaterial({ ...parameters, name, defines: defined(own), clipping: true });
    this.#apply();
  }

  /** Take part in this. A program is made anew only where it is another. */
  set(shading: Shading): void {
    this.#shading = { ...SHADING_DEFAULTS, ...shading };
    this.#apply();
  }

  /** Whether base and detail are compared: a program that may discard pixels costs every frame. */
  compare(isCompared: boolean): void {
    if (isCompared === this.#isCompared) return;
    this.#isCompared = isCompared;
    this.#apply();
  }

  /** Tell three.js that uniforms differ from those of the draw before. */
  touch(): void {
    this.material.uniformsNeedUpdate = true;
    if (this.#caster !== null) this.#caster.uniformsNeedUpdate = true;
  }

  /** Draw a mesh so; `onBeforeShadow` is its own. */
  dress(mesh: Mesh, casts: boolean): void {
    const { castShadow, receiveShadow } = this.#shading;
    mesh.receiveShadow = receiveShadow;
    mesh.castShadow = casts && castShadow;
    if (!mesh.castShadow) return;
    this.#caster ??= new ShaderMaterial({
      ...this.#parameters,
      ...CASTER_OFFSET,
      name: `${this.#name} in shadow maps`,
      defines: defined([...this.#own, "CASTER"]),
      fragmentShader: CASTER_SHADER,
      clipping: true,
    });
    mesh.customDepthMaterial = this.#caster;
    mesh.customDistanceMaterial = this.#caster;
  }

  dispose(): void {
    this.material.dispose();
    this.#caster?.dispose();
  }

  #apply(): void {
    const { material } = this;
    const { lit, receiveShadow, fog, toneMapped, clippingPlanes, clipIntersection, clipShadows } = this.#shading;
    const planes = clippingPlanes && [...clippingPlanes];
    Object.assign(material, { toneMapped, clippingPlanes: planes, clipIntersection, clipShadows });
    const words = [...this.#own];
    if (this.#isCompared) words.push("COMPARED");
    if (lit) words.push("LIT");
    if (receiveShadow) words.push("SHADOWED");
    if (material.fog === fog && Object.keys(material.defines).join() === words.join()) return;
    material.fog = fog;
    material.lights = lit || receiveShadow;
    material.defines = defined(words);
    material.needsUpdate = true;
  }
}

function defined(words: readonly string[]): Record<string, string> {
  return Object.fromEntries(words.map((word) => [word, ""]));
}
