/**
 * The base mesh on the GPU, with two lists of faces: the one that is drawn, and the one for the coming set, made ready in
 * slices. A swap exchanges them.
 *
 * A hidden face is three times vertex 0 in the list, so lists keep their length and only blocks that changed are written.
 */

import { type BufferGeometry, type Camera, type GLBufferAttribute, Mesh } from "three";

import { CoverCounters } from "../core/cover.ts";
import type { SceneFiles } from "../core/types.ts";
import { type GpuBuffer, type GpuImages, type GpuStore, imageFormOf } from "./gpu-store.ts";
import type { DrawFacts, GroundMaterial } from "./ground-material.ts";
import { indexAttribute, layoutOf, MeshRoom, setMeasure, sphereOf, stayInFrame, vertexParts } from "./mesh-room.ts";
import { MeshUpload } from "./mesh-upload.ts";
import type { MiniaturePose } from "./types.ts";

/** Faces that are written at once: 48 KB of indices. */
const BLOCK_FACES = 4096;
/** The model of the scene is drawn after the ground, over which it stands, and before whatever points at it. */
const MINIATURE_ORDER = 880;

/** Every face, drawn beside what is shown: the buffer is freed with the mesh. */
interface Whole {
  readonly mesh: Mesh;
  readonly buffer: GpuBuffer;
}

/** One of the two index lists: the front one is drawn, the back one is made ready for the coming set. */
interface Side {
  readonly buffer: GpuBuffer;
  readonly index: GLBufferAttribute;
  geometry: BufferGeometry | null;
  /** One byte per face, as the list on the GPU has it. */
  readonly hidden: Uint8Array;
  /** Blocks whose list is behind the counters. */
  readonly stale: Uint8Array;
  /** Next block of the first filling, or -1 once it is done. */
  filling: number;
  hiddenCount: number;
  hiddenHash: number;
}

/** Base mesh, cover counters, and their two lists. */
export class BaseGround {
  readonly mesh: Mesh;
  readonly #store: GpuStore;
  readonly #files: SceneFiles;
  readonly #counters: CoverCounters;
  /** Made by the first step: before, there may be no context. */
  #room: MeshRoom | null = null;
  #images: GpuImages | null = null;
  #upload: MeshUpload | null = null;
  readonly #scratch: Uint16Array | Uint32Array;
  readonly #facts: DrawFacts;
  readonly #material: GroundMaterial;
  /** All faces, drawn while base and detail are compared; null at any other time. */
  #compared: Whole | null = null;
  /** All faces, as the model of the scene; null at any other time. */
  #miniature: Whole | null = null;
  #miniaturePose: MiniaturePose | null = null;
  #sides: readonly [Side, Side] | null = null;
  #front: 0 | 1 = 0;
  #toAdd: number[] = [];
  #toRemove: number[] = [];
  #measureName: string | null = null;
  #targetRevision = -1;
  #preparedRevision = -1;

  constructor(store: GpuStore, files: SceneFiles, material: GroundMaterial) {
    this.#store = store;
    this.#files = files;
    this.#counters = new CoverCounters(files.cover);
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
    this.#material = material;
    this.mesh = new Mesh();
    this.mesh.name = "base";
    this.mesh.material = material.material;
    // The shader places the codes (translation, step): the mesh itself stays at the origin of the scene's frame.
    stayInFrame(this.mesh);
    // After the detail, which stands before it nearly everywhere: what it hides is not shaded.
    this.mesh.renderOrder = 1;
    this.mesh.visible = false;
    // Picking is face-boxes.ts's: three.js has no arrays of positions to walk.
    this.mesh.raycast = () => undefined;
    this.mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => material.bind(this.#facts, this.mesh, camera);
    this.mesh.onBeforeShadow = (_renderer, _scene, _camera, light: Camera) =>
      material.bind(this.#facts, this.mesh, light);
    this.dress();
  }

  /** After a change of what the ground takes part in. What is drawn of the base beside itself casts nothing. */
  dress(): void {
    this.#material.dress(this.mesh);
    if (this.#compared !== null) this.#material.dress(this.#compared.mesh, false);
  }

  /** Whether it is on the GPU, both lists included. */
  get isUploaded(): boolean {
    return this.mesh.visible;
  }

  /** Revision of the coming set that the back list shows, or -1. */
  get preparedRevision(): number {
    return this.#preparedRevision;
  }

  /** One byte per face of what is drawn, 1 for hidden. */
  get hidden(): Uint8Array | undefined {
    return this.#sides?.[this.#front].hidden;
  }

  get hiddenCount(): number {
    return this.#sides?.[this.#front].hiddenCount ?? 0;
  }

  /** Hash of the set of faces that the drawn list hides. */
  get hiddenHash(): number {
    return this.#sides?.[this.#front].hiddenHash ?? 0;
  }

  get faceCount(): number {
    return this.#files.base.faceCount;
  }

  /** Make the back list ready for the segments of these payloads, at whichever level; `step` does the work. */
  prepare(ids: readonly number[], revision: number): void {
    if (revision === this.#targetRevision) {
      return;
    }
    this.#targetRevision = revision;
    this.#preparedRevision = -1;
    // From where the counters are, not from what is drawn: a preparation that was cut short is not undone.
    const { segmentCount } = this.#files.manifest;
    const target = new Set(ids.map((id) => id % segmentCount));
    this.#toRemove = [...this.#counters.shown].filter((segment) => !target.has(segment));
    this.#toAdd = [...target].filter((segment) => !this.#counters.shown.has(segment));
  }

  /**
   * One slice of work: buffers, then both lists, then the mesh is switched on, then the back list is brought to the coming set.
   * Returns its bytes, or 0 where there was nothing to do. The front list is never written while it is drawn.
   */
  step(): number {
    this.#upload ??= this.#makeUpload();
    if (!this.#upload.isDone) {
      return Math.max(this.#upload.step(), 1);
    }
    this.#sides ??= this.#makeSides();
    for (const side of this.#sides) {
      if (side.filling >= 0) {
        return this.#fill(side);
      }
    }
    if (!this.mesh.visible) {
      this.#facts.map = this.#images && this.#store.asTexture(this.#images);
      this.mesh.visible = true;
      return 1;
    }
    return this.#stepBack();
  }

  /** Draw the list that was prepared. Nothing is uploaded. */
  flip(): void {
    if (this.#sides) {
      this.#front = this.#front === 0 ? 1 : 0;
      this.mesh.geometry = this.#geometryOf(this.#sides[this.#front]);
      // The list that is the back now is that of the set before.
      this.#preparedRevision = -1;
      this.#targetRevision = -1;
    }
  }

  /** Draw all of it beside what is shown, or not; at once. False where it is not on the GPU yet. */
  setCompared(isCompared: boolean): boolean {
    if (isCompared === (this.#compared !== null)) return true;
    if (this.#compared !== null) {
      this.#freeWhole(this.#compared);
      this.#compared = null;
      return true;
    }
    if (!this.mesh.visible) return false;
    const facts: DrawFacts = { ...this.#facts, side: -1 };
    this.#compared = this.#makeWhole("whole base");
    const { mesh } = this.#compared;
    mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => {
      facts.measure = this.#facts.measure;
      this.#material.bind(facts, mesh, camera);
    };
    this.dress();
    return true;
  }

  /** Draw all of it once more as a model of the scene, or not; at once. Nothing where it is not on the GPU yet. */
  setMiniature(pose: MiniaturePose | null): void {
    this.#miniaturePose = pose;
    if (pose === null || !this.mesh.visible) {
      if (this.#miniature !== null) this.#freeWhole(this.#miniature);
      this.#miniature = null;
      return;
    }
    if (this.#miniature !== null) return;
    this.#miniature = this.#makeWhole("miniature");
    const { mesh } = this.#miniature;
    mesh.material = this.#material.miniature;
    mesh.renderOrder = MINIATURE_ORDER;
    // Its sphere is that of the ground.
    mesh.frustumCulled = false;
    mesh.onBeforeRender = (renderer, _scene, camera: Camera) => {
      // Before the ground that it stands in, wherever that is nearer; in itself it still hides what lies behind.
      renderer.clearDepth();
      if (this.#miniaturePose !== null) this.#material.bindMiniature(this.#facts, mesh, camera, this.#miniaturePose);
    };
  }

  #freeWhole({ mesh, buffer }: Whole): void {
    mesh.removeFromParent();
    // three.js deletes the buffers of whatever attributes a geometry has: those are the base's, which is drawn on.
    for (const name of Object.keys(mesh.geometry.attributes)) mesh.geometry.deleteAttribute(name);
    mesh.geometry.dispose();
    this.#store.freeBuffer(buffer);
  }

  #makeWhole(name: string): Whole {
    const { indices } = this.#files.base;
    const buffer = this.#store.createBuffer(indices.byteLength, "indices");
    this.#store.writeBuffer(buffer, 0, new Uint8Array(indices.buffer, indices.byteOffset, indices.byteLength));
    const mesh = new Mesh(this.#makeGeometry(indexAttribute(buffer.buffer, indices)), this.#material.material);
    mesh.name = name;
    stayInFrame(mesh);
    mesh.renderOrder = this.mesh.renderOrder;
    mesh.raycast = () => undefined;
    setMeasure(mesh.geometry, this.#measure);
    this.mesh.parent?.add(mesh);
    return { mesh, buffer };
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    const info = this.#files.base.attributes.find((attribute) => attribute.name === name);
    this.#facts.measure = info ? [info.offset, info.step] : null;
    this.#measureName = name;
    for (const side of this.#sides ?? []) {
      setMeasure(this.#geometryOf(side), this.#measure);
    }
    for (const whole of [this.#compared, this.#miniature]) {
      if (whole !== null) setMeasure(whole.mesh.geometry, this.#measure);
    }
  }

  dispose(): void {
    this.setCompared(false);
    this.setMiniature(null);
    for (const side of this.#sides ?? []) {
      side.geometry?.dispose();
      this.#store.freeBuffer(side.buffer);
    }
    this.#sides = null;
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

  #makeSides(): readonly [Side, Side] {
    const make = (): Side => {
      const { base } = this.#files;
      const buffer = this.#store.createBuffer(base.indices.byteLength, "indices");
      return {
        buffer,
        index: indexAttribute(buffer.buffer, base.indices),
        geometry: null,
        hidden: new Uint8Array(base.faceCount),
        stale: new Uint8Array(Math.ceil(base.faceCount / BLOCK_FACES)),
        filling: 0,
        hiddenCount: 0,
        hiddenHash: 0,
      };
    };
    const sides = [make(), make()] as const;
    this.mesh.geometry.dispose();
    this.mesh.geometry = this.#geometryOf(sides[0]);
    return sides;
  }

  #geometryOf(side: Side): BufferGeometry {
    if (!side.geometry) {
      side.geometry = this.#makeGeometry(side.index);
      setMeasure(side.geometry, this.#measure);
    }
    return side.geometry;
  }

  #makeUpload(): MeshUpload {
    const { base } = this.#files;
    const parts = vertexParts(base);
    this.#room = new MeshRoom(this.#store, layoutOf(parts, null), base.vertexCount, 0);
    this.#images = base.image && this.#store.createImages(imageFormOf(base.image), 1);
    const target = { room: this.#room, firstVertex: 0, firstIndex: null, images: this.#images, layer: 0 };
    return new MeshUpload(this.#store, target, base, parts, true);
  }

  #makeGeometry(index: GLBufferAttribute): BufferGeometry {
    const geometry = this.#room!.geometry(index);
    geometry.boundingSphere = sphereOf(this.#files.base.bounds);
    return geometry;
  }

  #fill(side: Side): number {
    const bytes = this.#writeBlock(side, side.filling);
    side.filling = (side.filling + 1) * BLOCK_FACES < this.faceCount ? side.filling + 1 : -1;
    return bytes;
  }

  #stepBack(): number {
    // Segments first, which make blocks stale; then the stale blocks, one a step; the counts last, when all is written.
    const segment = this.#toRemove.pop();
    if (segment !== undefined) {
      return this.#mark(this.#counters.remove(segment));
    }
    const added = this.#toAdd.pop();
    if (added !== undefined) {
      return this.#mark(this.#counters.add(added));
    }
    if (this.#targetRevision < 0 || this.#preparedRevision === this.#targetRevision || !this.#sides) {
      return 0;
    }
    const back = this.#sides[this.#front === 0 ? 1 : 0];
    const block = back.stale.indexOf(1);
    if (block >= 0) {
      back.stale[block] = 0;
      back.hidden.set(
        this.#counters.hidden.subarray(block * BLOCK_FACES, (block + 1) * BLOCK_FACES),
        block * BLOCK_FACES,
      );
      return this.#writeBlock(back, block);
    }
    back.hiddenCount = this.#counters.hiddenCount;
    back.hiddenHash = this.#counters.hiddenHash;
    this.#preparedRevision = this.#targetRevision;
    return 1;
  }

  #mark(faces: Uint32Array): number {
    // Of both lists: the front one is brought up to date when a flip has made it the back.
    for (const side of this.#sides ?? []) {
      for (const face of faces) {
        side.stale[Math.floor(face / BLOCK_FACES)] = 1;
      }
    }
    return faces.length + 1;
  }

  #writeBlock(side: Side, block: number): number {
    const { indices, faceCount } = this.#files.base;
    const first = block * BLOCK_FACES;
    const count = Math.min(BLOCK_FACES, faceCount - first);
    const out = this.#scratch;
    out.set(indices.subarray(first * 3, (first + count) * 3));
    for (let face = 0; face < count; face += 1) {
      if (side.hidden[first + face] === 1) {
        out.fill(0, face * 3, face * 3 + 3);
      }
    }
    const size = out.BYTES_PER_ELEMENT;
    const bytes = new Uint8Array(out.buffer, 0, count * 3 * size);
    this.#store.writeBuffer(side.buffer, first * 3 * size, bytes);
    return bytes.length;
  }
}
