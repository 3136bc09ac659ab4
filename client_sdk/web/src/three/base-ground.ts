/**
 * The base mesh on the GPU, with two lists of faces: the one that is drawn, and one that is prepared for the next set of
 * segments, in slices. A swap exchanges them.
 *
 * A hidden face is three times vertex 0 in the list, so lists keep their length and only blocks that changed are written.
 */

import { type BufferGeometry, type Camera, type GLBufferAttribute, Mesh } from "three";

import type { SceneFiles } from "../core/types.ts";
import { countFaces, hasFace, hashFaces } from "./face-set.ts";
import { type GpuBuffer, type GpuImages, type GpuStore, imageFormOf } from "./gpu-store.ts";
import type { DrawFacts, GroundMaterial } from "./ground-material.ts";
import { indexAttribute, layoutOf, MeshRoom, setMeasure, sphereOf, stayInFrame, vertexParts } from "./mesh-room.ts";
import { MeshUpload } from "./mesh-upload.ts";
import type { MiniaturePose } from "./types.ts";

/** Faces that are written at once: 48 KB of indices. A multiple of 8. */
const BLOCK_FACES = 4096;
/** The model of the scene is drawn after the ground, over which it stands, and before whatever points at it. */
const MINIATURE_ORDER = 880;

/** One of the two index lists. */
interface FaceList {
  readonly buffer: GpuBuffer;
  readonly geometry: BufferGeometry;
  /** Bit set of the faces that the list on the GPU hides. */
  readonly hidden: Uint8Array;
  hiddenCount: number;
  hiddenHash: number;
}

/** A list of all faces, and the meshes that are drawn by it in addition to the ground. */
interface WholeBase {
  readonly buffer: GpuBuffer;
  compared: Mesh | null;
  miniature: Mesh | null;
}

/** Base mesh and its lists of faces. */
export class BaseGround {
  readonly mesh: Mesh;
  readonly #store: GpuStore;
  readonly #files: SceneFiles;
  readonly #material: GroundMaterial;
  readonly #facts: DrawFacts;
  readonly #scratch: Uint16Array | Uint32Array;
  /** Created by the first step: before it, there may be no context. */
  #room: MeshRoom | null = null;
  #images: GpuImages | null = null;
  #upload: MeshUpload | null = null;
  #lists: readonly [FaceList, FaceList] | null = null;
  #front: 0 | 1 = 0;
  /** Blocks of both lists that were written at least once. */
  #filledBlocks = 0;
  #whole: WholeBase | null = null;
  #miniaturePose: MiniaturePose | null = null;
  #measureName: string | null = null;
  /** Bit set that the back list is to have, and the one that it has. */
  #target: Uint8Array | null = null;
  #prepared: Uint8Array | null = null;

  constructor(store: GpuStore, files: SceneFiles, material: GroundMaterial) {
    this.#store = store;
    this.#files = files;
    this.#material = material;
    const { base } = files;
    this.#scratch =
      base.indices instanceof Uint16Array ? new Uint16Array(BLOCK_FACES * 3) : new Uint32Array(BLOCK_FACES * 3);
    this.#facts = {
      translation: base.translation,
      stepM: base.stepM,
      uvScale: base.uvScale,
      pushM: files.manifest.deviationM,
      map: null,
      hasTint: base.colours !== null,
      hasRegion: base.regionIds !== null,
      measure: null,
      side: 0,
    };
    this.mesh = this.#makeMesh("base");
    this.mesh.visible = false;
    this.mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => material.bind(this.#facts, this.mesh, camera);
    this.mesh.onBeforeShadow = (_renderer, _scene, _camera, light: Camera) =>
      material.bind(this.#facts, this.mesh, light);
    this.dress();
  }

  /** Apply a change of the shading. Only the base itself casts shadows. */
  dress(): void {
    this.#material.dress(this.mesh);
    if (this.#whole?.compared) this.#material.dress(this.#whole.compared, false);
  }

  /** Whether it is on the GPU, both lists included. */
  get isUploaded(): boolean {
    return this.mesh.visible;
  }

  /** Bit set of the faces that are not drawn. */
  get hidden(): Uint8Array | undefined {
    return this.#lists?.[this.#front].hidden;
  }

  get hiddenCount(): number {
    return this.#lists?.[this.#front].hiddenCount ?? 0;
  }

  /** Hash of the set of faces that are not drawn. */
  get hiddenHash(): number {
    return this.#lists?.[this.#front].hiddenHash ?? 0;
  }

  get faceCount(): number {
    return this.#files.base.faceCount;
  }

  /** Prepare the back list to hide these faces, a bit set that does not change any more; `step` does the work. */
  prepare(hidden: Uint8Array): void {
    this.#target = hidden;
  }

  /** Whether `flip` would hide the faces of this very object. */
  isPreparedFor(hidden: Uint8Array): boolean {
    return this.#prepared === hidden;
  }

  /**
   * One slice of work: buffers, then both lists, then the mesh becomes visible, then the back list follows `prepare`. Returns
   * its bytes, or 0 where there was nothing to do. The front list is never written while it is drawn.
   */
  step(): number {
    this.#upload ??= this.#makeUpload();
    if (!this.#upload.isDone) return Math.max(this.#upload.step(), 1);
    this.#lists ??= this.#makeLists();
    const [first, second] = this.#lists;
    if (this.#filledBlocks < this.#blockCount) {
      const block = this.#filledBlocks;
      this.#filledBlocks += 1;
      return this.#writeBlock(first, block) + this.#writeBlock(second, block);
    }
    if (!this.mesh.visible) {
      this.#facts.map = this.#images && this.#store.asTexture(this.#images);
      this.mesh.visible = true;
      return 1;
    }
    return this.#prepareStep();
  }

  /** Draw the list that was prepared. Nothing is uploaded. */
  flip(): void {
    if (this.#lists === null) return;
    this.#front = this.#front === 0 ? 1 : 0;
    this.mesh.geometry = this.#lists[this.#front].geometry;
    this.#target = null;
    this.#prepared = null;
  }

  /** Also draw all faces, for a comparison with the detail, or stop it. False where the base is not on the GPU yet. */
  setCompared(isCompared: boolean): boolean {
    if (!isCompared) {
      this.#endWhole("compared");
      return true;
    }
    if (!this.mesh.visible) return false;
    this.#whole ??= this.#makeWhole();
    if (this.#whole.compared !== null) return true;
    const mesh = this.#addWhole("whole base");
    const facts: DrawFacts = { ...this.#facts, side: -1 };
    mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => {
      facts.measure = this.#facts.measure;
      this.#material.bind(facts, mesh, camera);
    };
    this.#whole.compared = mesh;
    this.dress();
    return true;
  }

  /** Also draw all faces as a small model of the scene, or stop it. Nothing where the base is not on the GPU yet. */
  setMiniature(pose: MiniaturePose | null): void {
    this.#miniaturePose = pose;
    if (pose === null || !this.mesh.visible) {
      this.#endWhole("miniature");
      return;
    }
    this.#whole ??= this.#makeWhole();
    if (this.#whole.miniature !== null) return;
    const mesh = this.#addWhole("miniature");
    mesh.material = this.#material.miniature;
    mesh.renderOrder = MINIATURE_ORDER;
    // Its bounding sphere is that of the ground.
    mesh.frustumCulled = false;
    mesh.onBeforeRender = (renderer, _scene, camera: Camera) => {
      // In front of the ground wherever that is nearer; its own faces still hide each other.
      renderer.clearDepth();
      if (this.#miniaturePose !== null) this.#material.bindMiniature(this.#facts, mesh, camera, this.#miniaturePose);
    };
    this.#whole.miniature = mesh;
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    const info = this.#files.base.attributes.find((attribute) => attribute.name === name);
    this.#facts.measure = info ? [info.offset, info.step] : null;
    this.#measureName = name;
    for (const list of this.#lists ?? []) setMeasure(list.geometry, this.#measure);
    for (const mesh of [this.#whole?.compared, this.#whole?.miniature]) {
      if (mesh) setMeasure(mesh.geometry, this.#measure);
    }
  }

  dispose(): void {
    this.setCompared(false);
    this.setMiniature(null);
    for (const list of this.#lists ?? []) {
      list.geometry.dispose();
      this.#store.freeBuffer(list.buffer);
    }
    this.#lists = null;
    this.#upload?.free();
    this.#room?.free();
    this.#room = null;
    if (this.#images !== null) this.#store.freeImages(this.#images);
    this.#images = null;
    this.#facts.map?.dispose();
    this.mesh.visible = false;
    this.mesh.removeFromParent();
  }

  /** Known once it is uploaded. */
  get #measure(): GLBufferAttribute | undefined {
    return this.#measureName === null ? undefined : this.#room?.measures.get(this.#measureName);
  }

  get #blockCount(): number {
    return Math.ceil(this.faceCount / BLOCK_FACES);
  }

  #makeMesh(name: string, geometry?: BufferGeometry): Mesh {
    const mesh = new Mesh(geometry, this.#material.material);
    mesh.name = name;
    // The shader places the codes (translation, step): the mesh itself stays at the origin of the scene's frame.
    stayInFrame(mesh);
    // After the detail, which is in front of it nearly everywhere: what that hides is not shaded.
    mesh.renderOrder = 1;
    // three.js has no positions to test: Terrain.raycast does it for the whole ground.
    mesh.raycast = () => undefined;
    return mesh;
  }

  #makeUpload(): MeshUpload {
    const { base } = this.#files;
    const parts = vertexParts(base);
    this.#room = new MeshRoom(this.#store, layoutOf(parts, null), base.vertexCount, 0);
    this.#images = base.image && this.#store.createImages(imageFormOf(base.image), 1);
    const target = { room: this.#room, firstVertex: 0, firstIndex: null, images: this.#images, layer: 0 };
    return new MeshUpload(this.#store, target, base, parts, true);
  }

  #makeLists(): readonly [FaceList, FaceList] {
    const make = (): FaceList => {
      const buffer = this.#store.createBuffer(this.#files.base.indices.byteLength, "indices");
      const hidden = new Uint8Array(Math.ceil(this.faceCount / 8));
      return { buffer, geometry: this.#geometryOf(buffer), hidden, hiddenCount: 0, hiddenHash: 0 };
    };
    const lists = [make(), make()] as const;
    this.mesh.geometry.dispose();
    this.mesh.geometry = lists[0].geometry;
    return lists;
  }

  #geometryOf({ buffer }: GpuBuffer): BufferGeometry {
    const { indices, bounds } = this.#files.base;
    const geometry = this.#room!.geometry(indexAttribute(buffer, indices));
    geometry.boundingSphere = sphereOf(bounds);
    setMeasure(geometry, this.#measure);
    return geometry;
  }

  /** Write the next block in which the back list differs from the target; the last step counts. */
  #prepareStep(): number {
    const target = this.#target;
    if (target === null || target === this.#prepared || this.#lists === null) return 0;
    const back = this.#lists[this.#front === 0 ? 1 : 0];
    const changed = target.findIndex((bits, at) => bits !== back.hidden[at]);
    if (changed >= 0) {
      const block = Math.floor((changed * 8) / BLOCK_FACES);
      const begin = (block * BLOCK_FACES) / 8;
      back.hidden.set(target.subarray(begin, begin + BLOCK_FACES / 8), begin);
      return this.#writeBlock(back, block);
    }
    back.hiddenCount = countFaces(back.hidden);
    back.hiddenHash = hashFaces(back.hidden);
    this.#prepared = target;
    return 1;
  }

  #writeBlock({ buffer, hidden }: FaceList, block: number): number {
    const { indices } = this.#files.base;
    const first = block * BLOCK_FACES;
    const count = Math.min(BLOCK_FACES, this.faceCount - first);
    const out = this.#scratch;
    out.set(indices.subarray(first * 3, (first + count) * 3));
    for (let face = 0; face < count; face += 1) {
      if (hasFace(hidden, first + face)) out.fill(0, face * 3, face * 3 + 3);
    }
    const size = out.BYTES_PER_ELEMENT;
    const bytes = new Uint8Array(out.buffer, 0, count * 3 * size);
    this.#store.writeBuffer(buffer, first * 3 * size, bytes);
    return bytes.length;
  }

  #makeWhole(): WholeBase {
    const { indices } = this.#files.base;
    const buffer = this.#store.createBuffer(indices.byteLength, "indices");
    this.#store.writeBuffer(buffer, 0, new Uint8Array(indices.buffer, indices.byteOffset, indices.byteLength));
    return { buffer, compared: null, miniature: null };
  }

  #addWhole(name: string): Mesh {
    const mesh = this.#makeMesh(name, this.#geometryOf(this.#whole!.buffer));
    this.mesh.parent?.add(mesh);
    return mesh;
  }

  #endWhole(part: "compared" | "miniature"): void {
    const whole = this.#whole;
    const mesh = whole?.[part];
    if (!whole || !mesh) return;
    whole[part] = null;
    mesh.removeFromParent();
    // three.js deletes the buffers of a geometry's attributes: these are the base's, which is still drawn.
    for (const name of Object.keys(mesh.geometry.attributes)) mesh.geometry.deleteAttribute(name);
    // The same holds for the list, which the other mesh may be drawn by.
    mesh.geometry.index = null;
    mesh.geometry.dispose();
    if (whole.compared !== null || whole.miniature !== null) return;
    this.#store.freeBuffer(whole.buffer);
    this.#whole = null;
  }
}
