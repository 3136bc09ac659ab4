/** The materials of base and pages of segments: one shader, whose uniforms are set per draw. */

import {
  type Camera,
  DataTexture,
  DoubleSide,
  GLSL3,
  Matrix4,
  type Mesh,
  RGBAFormat,
  ShaderMaterial,
  SRGBColorSpace,
  type Texture,
  UniformsLib,
  UniformsUtils,
  Vector2,
  Vector3,
} from "three";

import type { RegionFacts, SceneManifest, TaughtPicture, Vec3 } from "../core/types.ts";
import {
  FRAGMENT_SHADER,
  MAX_RANGES,
  MODE_NUMBER,
  TINT_RELIEF,
  TRAIT_VECTORS,
  VERTEX_SHADER,
} from "./ground-shader.ts";
import { ShadedMaterial, type Shading } from "./ground-shading.ts";
import {
  attributeRamp,
  NO_VALUE,
  nameColours,
  PLAIN,
  RAMP_STOPS,
  type Rgb,
  regionColour,
  slopeRamp,
  toByte,
} from "./palette.ts";
import { TaughtLook } from "./taught-look.ts";
import type { MiniaturePose, ViewMode } from "./types.ts";

/** What a mesh of any kind has. */
interface MeshFacts {
  /** Null until it is uploaded, or where there is none. */
  map: Texture | null;
  readonly hasTint: boolean;
  readonly hasRegion: boolean;
}

/** What differs between two draws of the base. */
export interface DrawFacts extends MeshFacts {
  readonly translation: Vec3;
  readonly stepM: number;
  readonly uvScale: readonly [number, number];
  /** How far it is pushed back along the line of sight. */
  readonly pushM: number;
  /** Offset and step of the attribute in view; null where it has none. */
  measure: readonly [number, number] | null;
  /** The base (0), or the whole base beside which detail is compared (-1). */
  readonly side: -1 | 0;
}

/** What differs between two pages of segments. */
export interface PageFacts extends MeshFacts {
  /** Whether its segments have the attribute in view. */
  hasMeasure: boolean;
}

/** Beside the base (0) and the whole base that it is compared with (-1): see {@link DrawFacts.side}. */
const DETAIL_SIDE = 1;

/** What became sharp is washed with it for a moment, linear light: of no rock, seen by the colour-blind too. */
const FRESH: Vec3 = [0.1, 0.75, 1];

/** Width of the texture that holds the regions' colours; a region's id is `x + 256 y`. */
const REGION_TEXTURE_SIDE = 256;
/** The coarse part of the eye is a multiple of this, or of the grid's step where that is larger; both are powers of two. */
const EYE_GRID_M = 0.0625;

/** Material and its uniforms. `bind` is called for each draw, once per eye. */
export class GroundMaterial {
  readonly #base: ShadedMaterial;
  readonly #paged: ShadedMaterial;
  /** For the model of the scene: the same uniforms, and another way from a place to its pixel. */
  readonly miniature: ShaderMaterial;
  #gridM: number;
  readonly #uniforms;
  #regionColours: DataTexture;
  #nameColours: DataTexture;
  readonly #ramps = rampTexture();
  readonly #taught = new TaughtLook();

  constructor(manifest: SceneManifest, regions: readonly RegionFacts[]) {
    this.#gridM = Math.max(manifest.stepM, EYE_GRID_M);
    this.#regionColours = regionTexture(regions, ownColour);
    this.#nameColours = nameTexture(regions);
    this.#uniforms = {
      translation: { value: new Vector3() },
      stepM: { value: 1 },
      eyeCoarse: { value: new Vector3() },
      eyeFine: { value: new Vector3() },
      pushM: { value: 0 },
      uvScale: { value: new Vector2() },
      mode: { value: 0 },
      hasMap: { value: false },
      hasTint: { value: false },
      hasRegion: { value: false },
      hasMeasure: { value: false },
      map: { value: null as Texture | null },
      regionColours: { value: this.#regionColours },
      noValue: { value: new Vector3() },
      plain: { value: linear(PLAIN) },
      measureScale: { value: new Vector2() },
      measureRange: { value: new Vector2() },
      ramps: { value: this.#ramps },
      relief: { value: 1 },
      mapRelief: { value: mapRelief(manifest) },
      highlight: { value: -1 },
      freshColour: { value: new Vector3(...FRESH) },
      fresh: { value: 0 },
      splitX: { value: 0 },
      side: { value: 0 },
      modelScale: { value: 1 },
      traits: { value: new Float32Array(4 * TRAIT_VECTORS * MAX_RANGES) },
      ...this.#taught.uniforms,
    };
    const program = {
      glslVersion: GLSL3,
      vertexShader: VERTEX_SHADER,
      fragmentShader: FRAGMENT_SHADER,
      // Fog and lights are three.js's to fill.
      uniforms: { ...UniformsUtils.clone({ ...UniformsLib.fog, ...UniformsLib.lights }), ...this.#uniforms },
      side: DoubleSide,
    };
    this.#base = new ShadedMaterial(program, "ground", []);
    this.#paged = new ShadedMaterial(program, "pages", ["PAGED"]);
    this.miniature = new ShaderMaterial({ ...program, name: "miniature", defines: { MINIATURE: "" } });
    this.setMode({ kind: "colour" }, "light");
  }

  /** For the base. */
  get material(): ShaderMaterial {
    return this.#base.material;
  }

  /** For pages. A material of its own: three.js would look its program up anew at every change between base and pages. */
  get paged(): ShaderMaterial {
    return this.#paged.material;
  }

  /** What base and pages take part in; each mesh is to be dressed anew then. The model is a thing of its own. */
  setShading(shading: Shading): void {
    this.#base.set(shading);
    this.#paged.set(shading);
    this.miniature.toneMapped = this.material.toneMapped;
  }

  /** Shadows of a mesh that one of the two materials draws; `casts`: whether it is to cast any. */
  dress(mesh: Mesh, casts = true): void {
    (mesh.material === this.paged ? this.#paged : this.#base).dress(mesh, casts);
  }

  /** For every draw from now on. */
  setMode(mode: ViewMode, theme: "light" | "dark"): void {
    this.#uniforms.mode.value = MODE_NUMBER[mode.kind];
    this.#uniforms.noValue.value.copy(linear(NO_VALUE[theme]));
    this.#uniforms.regionColours.value = mode.kind === "names" ? this.#nameColours : this.#regionColours;
    if (mode.kind === "attribute") {
      this.#uniforms.measureRange.value.set(mode.min, mode.max);
    }
  }

  /** Dim whatever is not of this region; null ends it. */
  highlight(region: number | null): void {
    this.#uniforms.highlight.value = region ?? -1;
  }

  /** Lay what strokes have taught over every mode; null takes it away. */
  setTaught(picture: TaughtPicture | null): void {
    this.#taught.set(picture);
  }

  /** How strongly what is fresh is washed with colour, 0 to 1. */
  setFresh(share: number): void {
    this.#uniforms.fresh.value = share;
  }

  /** Compare base and detail at this column of the picture, pixels; null ends it. */
  setSplit(splitX: number | null): void {
    this.#uniforms.splitX.value = splitX ?? 0;
    this.#base.compare(splitX !== null);
    this.#paged.compare(splitX !== null);
  }

  /** Set what differs, and where this eye is. three.js calls it (onBeforeRender, onBeforeShadow) with the eye's own camera, or a light's. */
  bind(facts: DrawFacts, mesh: Mesh, camera: Camera): void {
    this.#bind(facts, eyeInFrame(mesh, camera));
    this.#base.touch();
  }

  /** As `bind`, for {@link miniature}: the eye is as far from the scene's middle as from the model's, in metres of the ground. */
  bindMiniature(facts: DrawFacts, mesh: Mesh, camera: Camera, { middle, at, scale }: MiniaturePose): void {
    const eye = eyeInFrame(mesh, camera);
    eye.set(
      middle[0] + (eye.x - at[0]) / scale,
      middle[1] + (eye.y - at[1]) / scale,
      middle[2] + (eye.z - at[2]) / scale,
    );
    this.#uniforms.modelScale.value = scale;
    this.#bind(facts, eye);
    this.miniature.uniformsNeedUpdate = true;
  }

  /** As `bind`, for a page: `traits` are those of the ranges that are drawn, in their order. */
  bindPage(facts: PageFacts, traits: Float32Array<ArrayBuffer>, mesh: Mesh, camera: Camera): void {
    const u = this.#uniforms;
    u.traits.value = traits;
    u.pushM.value = 0;
    u.hasMeasure.value = facts.hasMeasure;
    u.side.value = DETAIL_SIDE;
    this.#bindMesh(facts, eyeInFrame(mesh, camera));
    this.#paged.touch();
  }

  #bind(facts: DrawFacts, eye: Vector3): void {
    const u = this.#uniforms;
    u.translation.value.set(...facts.translation);
    u.stepM.value = facts.stepM;
    u.uvScale.value.set(...facts.uvScale);
    u.pushM.value = facts.pushM;
    u.hasMeasure.value = facts.measure !== null;
    u.measureScale.value.set(facts.measure?.[0] ?? 0, facts.measure?.[1] ?? 0);
    u.side.value = facts.side;
    this.#bindMesh(facts, eye);
  }

  #bindMesh(facts: MeshFacts, { x, y, z }: Vector3): void {
    const u = this.#uniforms;
    u.hasMap.value = facts.map !== null;
    u.map.value = facts.map;
    u.hasTint.value = facts.hasTint;
    u.hasRegion.value = facts.hasRegion;
    // The eye in two parts. The coarse one lies on the grid of the codes, so the shader's difference to it is exact in
    // float32; the fine one is small. One number for both would shake by millimetres far from the origin.
    const grid = this.#gridM;
    const coarse = u.eyeCoarse.value.set(
      Math.round(x / grid) * grid,
      Math.round(y / grid) * grid,
      Math.round(z / grid) * grid,
    );
    u.eyeFine.value.set(x - coarse.x, y - coarse.y, z - coarse.z);
  }

  /** Grid and regions of another version. */
  setVersion(manifest: SceneManifest, regions: readonly RegionFacts[]): void {
    this.#gridM = Math.max(manifest.stepM, EYE_GRID_M);
    this.#uniforms.mapRelief.value = mapRelief(manifest);
    // Owned here: the material only refers to it.
    const showsNames = this.#uniforms.regionColours.value === this.#nameColours;
    this.#regionColours.dispose();
    this.#nameColours.dispose();
    this.#regionColours = regionTexture(regions, ownColour);
    this.#nameColours = nameTexture(regions);
    this.#uniforms.regionColours.value = showsNames ? this.#nameColours : this.#regionColours;
  }

  dispose(): void {
    this.#regionColours.dispose();
    this.#nameColours.dispose();
    this.#ramps.dispose();
    this.#taught.dispose();
    this.#base.dispose();
    this.#paged.dispose();
    this.miniature.dispose();
  }
}

const eyeNow = new Vector3();
const intoFrame = new Matrix4();

/** Where a camera is in the frame of the ground that it draws; overwritten by the next call. */
function eyeInFrame(mesh: Mesh, camera: Camera): Vector3 {
  return eyeNow.setFromMatrixPosition(camera.matrixWorld).applyMatrix4(intoFrame.copy(mesh.matrixWorld).invert());
}

/** A photograph has its own light; an image of the points' colours stands beside detail with those colours, lit. */
function mapRelief(manifest: SceneManifest): number {
  return manifest.texturesOf === "points" ? TINT_RELIEF : 0;
}

/** Linear light of an sRGB colour. */
export function linear(colour: Rgb): Vector3 {
  const [r, g, b] = colour.map((channel) =>
    channel <= 0.04045 ? channel / 12.92 : ((channel + 0.055) / 1.055) ** 2.4,
  );
  return new Vector3(r, g, b);
}

/** A row for attributes, a row for slopes; sRGB as it is, since the shader mixes it so. */
function rampTexture(): DataTexture {
  const stops = [...attributeRamp(), ...slopeRamp()];
  const texels = Uint8Array.from(stops.flatMap((stop) => [...stop.map(toByte), 255]));
  const texture = new DataTexture(texels, RAMP_STOPS, 2, RGBAFormat);
  texture.needsUpdate = true;
  return texture;
}

function ownColour(region: RegionFacts): Rgb {
  return regionColour(region.stableId ?? region.id);
}

function nameTexture(regions: readonly RegionFacts[]): DataTexture {
  const colours = nameColours(regions);
  return regionTexture(regions, ({ label }) => colours.get(label ?? "") ?? null);
}

/** A texel for every region; clear where it has no colour. */
function regionTexture(regions: readonly RegionFacts[], colourOf: (region: RegionFacts) => Rgb | null): DataTexture {
  const maxId = regions.reduce((id, region) => Math.max(id, region.id), 0);
  const rows = Math.floor(maxId / REGION_TEXTURE_SIDE) + 1;
  const texels = new Uint8Array(REGION_TEXTURE_SIDE * rows * 4).fill(255);
  for (const region of regions) {
    const colour = colourOf(region);
    texels.set(colour === null ? [0, 0, 0, 0] : colour.map(toByte), region.id * 4);
  }
  const texture = new DataTexture(texels, REGION_TEXTURE_SIDE, rows, RGBAFormat);
  texture.colorSpace = SRGBColorSpace;
  texture.needsUpdate = true;
  return texture;
}
