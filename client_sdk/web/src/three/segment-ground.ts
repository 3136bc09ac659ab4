/** One segment on the GPU: uploaded in slices, then warmed, then shown and hidden by a flag. */

import { type Camera, Mesh } from "three";

import type { AttributeCodes, MeshData } from "../core/types.ts";
import { setMeasure } from "./base-ground.ts";
import { FaceBoxes } from "./face-boxes.ts";
import type { GpuStore } from "./gpu-store.ts";
import { type DrawFacts, type GroundMaterial, linear } from "./ground-material.ts";
import { geometryOf, MeshUpload } from "./mesh-upload.ts";
import { segmentColour } from "./palette.ts";

/** A segment's mesh. `step` until `mesh` is there; `free` once. */
export class SegmentGround {
  /** Of the payload: which segment, and at which level. */
  readonly id: number;
  /** Of the scene, at whichever level. */
  readonly segment: number;
  readonly faceCount: number;
  /** For picking; keeps positions, indices and region ids of the decoded mesh, and nothing else of it. */
  readonly boxes: FaceBoxes;
  readonly bounds: MeshData["bounds"];
  mesh: Mesh | null = null;
  readonly #upload: MeshUpload;
  readonly #facts: DrawFacts;
  readonly #material: GroundMaterial;
  readonly #attributes: readonly Pick<AttributeCodes, "name" | "offset" | "step">[];
  #measureName: string | null;
  #meshData: MeshData | null;

  constructor(store: GpuStore, id: number, data: MeshData, material: GroundMaterial, measureName: string | null) {
    this.id = id;
    this.segment = data.segment;
    this.faceCount = data.faceCount;
    this.bounds = data.bounds;
    const { translation, stepM, positions, indices, regionIds, faceCount, bounds } = data;
    this.boxes = new FaceBoxes({ translation, stepM, positions, indices, regionIds, faceCount, bounds });
    this.#attributes = data.attributes.map(({ name, offset, step }) => ({ name, offset, step }));
    this.#measureName = measureName;
    this.#material = material;
    this.#upload = new MeshUpload(store, data, false);
    this.#meshData = data;
    this.#facts = {
      translation,
      stepM,
      uvScale: data.uvScale,
      pushM: 0,
      map: null,
      hasTint: data.colours !== null,
      hasRegion: regionIds !== null,
      measure: null,
      segmentColour: linear(segmentColour(data.segment)),
      isFresh: false,
      side: 1,
    };
  }

  /** Washed with colour as long as the material says. */
  set isFresh(isFresh: boolean) {
    this.#facts.isFresh = isFresh;
  }

  /** Upload one slice. Returns its bytes. */
  step(): number {
    const bytes = this.#upload.step();
    if (this.#upload.isDone && this.#meshData && this.#upload.index) {
      this.mesh = new Mesh(geometryOf(this.#upload, this.#upload.index, this.#meshData), this.#material.material);
      // On the GPU: picking keeps positions and indices, everything else may be collected.
      this.#meshData = null;
      this.#facts.map = this.#upload.map;
      this.mesh.name = `segment ${this.id}`;
      this.mesh.matrixAutoUpdate = false;
      this.mesh.raycast = () => undefined;
      this.mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => this.#material.bind(this.#facts, camera);
      this.setMeasure(this.#measureName);
      this.#warm(this.mesh);
    }
    return Math.max(bytes, 1);
  }

  /** The frame in which it was drawn without a single face is over: hidden until a swap. */
  endWarming(): void {
    if (this.mesh) {
      this.mesh.geometry.setDrawRange(0, Number.POSITIVE_INFINITY);
      this.mesh.frustumCulled = true;
      this.mesh.visible = false;
    }
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    this.#measureName = name;
    const info = this.#attributes.find((attribute) => attribute.name === name);
    this.#facts.measure = info ? [info.offset, info.step] : null;
    if (this.mesh) {
      setMeasure(this.mesh.geometry, name === null ? undefined : this.#upload.measures.get(name));
    }
  }

  free(): void {
    this.mesh?.removeFromParent();
    // Gives back three.js's vertex array alone: the buffers are the upload's, the material is everybody's.
    this.mesh?.geometry.dispose();
    this.mesh = null;
    this.#meshData = null;
    this.#upload.free();
  }

  /**
   * Draw it for one frame with no face at all: three.js then makes its vertex array and looks its program up, and neither is
   * left for the frame of the swap, in which hundreds of segments may appear.
   */
  #warm(mesh: Mesh): void {
    mesh.geometry.setDrawRange(0, 0);
    mesh.frustumCulled = false;
    mesh.visible = true;
  }
}
