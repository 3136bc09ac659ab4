/**
 * A page: segments in common buffers, drawn by one call.
 *
 * three.js draws what is marked as its `BatchedMesh` by ranges that we choose, with `WEBGL_multi_draw` in one call and without it
 * range by range from the same buffers. Ranges are looked through for each camera, so each eye draws what it sees.
 */

import {
  BufferGeometry,
  type Camera,
  type ExternalTexture,
  Frustum,
  type Material,
  Matrix4,
  Mesh,
  Sphere,
} from "three";

import type { MeshData, MeshImage, SegmentKey } from "../core/types.ts";
import type { GpuImages, GpuStore, ImageForm } from "./gpu-store.ts";
import { type GroundMaterial, linear } from "./ground-material.ts";
import { MAX_RANGES, TRAIT_VECTORS } from "./ground-shader.ts";
import {
  type IndexArray,
  MeshRoom,
  type RoomLayout,
  roomBytes,
  setMeasure,
  sphereOf,
  stayInFrame,
} from "./mesh-room.ts";
import { segmentColour } from "./palette.ts";

const TRAITS = 4 * TRAIT_VECTORS;
/** Within a range's traits: scale of the attribute in view; colour of the segment; layer, and whether it is fresh. */
const MEASURE_AT = 6;
const COLOUR_AT = 8;
const MARKS_AT = 11;

/** A mesh that three.js takes for a `BatchedMesh`, whose own buffers and matrices ours have no use for. */
export class PageMesh extends Mesh {
  readonly isBatchedMesh = true;
  readonly _multiDrawStarts = new Int32Array(MAX_RANGES);
  readonly _multiDrawCounts = new Int32Array(MAX_RANGES);
  _multiDrawCount = 0;
  readonly _matricesTexture = null;
  readonly _indirectTexture = null;
  readonly _colorsTexture = null;
  /** What versions before 0.186 and 0.184 ask for. */
  readonly colorTexture = null;
  readonly _multiDrawInstances = null;

  constructor(geometry: BufferGeometry, material: Material) {
    super(geometry, material);
    this.name = "page";
    // The shader places the codes: the mesh itself stays at the origin of the scene's frame.
    stayInFrame(this);
    // Picking is face-boxes.ts's: three.js has no arrays of positions to walk.
    this.raycast = () => undefined;
  }
}

/** What of a mesh is kept beside the GPU while it is in a page: what it takes to move it, and to draw it. */
export class PageRange {
  /** Of the payload. */
  readonly id: SegmentKey;
  readonly vertexCount: number;
  /** Picking has them as well. */
  readonly indices: IndexArray;
  readonly sphere: Sphere;
  readonly traits = new Float32Array(TRAITS);
  page: Page;
  firstVertex: number;
  firstIndex: number;
  #layer = 0;
  #isFresh = false;
  /** Whether everything of it is on the GPU. */
  isWhole = false;
  #isShown = false;

  constructor(id: SegmentKey, data: MeshData, page: Page, firstVertex: number, firstIndex: number) {
    this.id = id;
    this.vertexCount = data.vertexCount;
    this.indices = data.indices;
    this.sphere = sphereOf(data.bounds);
    this.page = page;
    this.firstVertex = firstVertex;
    this.firstIndex = firstIndex;
    this.traits.set([...data.translation, data.stepM, ...data.uvScale, 0, 0]);
  }

  /** Number in the scene: its colour in mode `segments`. */
  set segment(segment: number) {
    this.traits.set(linear(segmentColour(segment)).toArray(), COLOUR_AT);
  }

  get isShown(): boolean {
    return this.#isShown;
  }

  set isShown(isShown: boolean) {
    if (isShown === this.#isShown) return;
    this.#isShown = isShown;
    this.page.look();
  }

  /** Of its image in the page's. */
  get layer(): number {
    return this.#layer;
  }

  set layer(layer: number) {
    this.#layer = layer;
    this.#mark();
  }

  /** Washed with colour as long as the material says. */
  set isFresh(isFresh: boolean) {
    this.#isFresh = isFresh;
    this.#mark();
  }

  /** Offset and step of the attribute in view, or none. */
  set measure(scale: readonly [number, number] | null) {
    this.traits.set(scale ?? [0, 0], MEASURE_AT);
  }

  #mark(): void {
    this.traits[MARKS_AT] = 2 * this.#layer + Number(this.#isFresh);
  }
}

/** Which meshes can lie in one page. */
export interface PageForm {
  readonly layout: RoomLayout;
  /** Null for meshes without an image. */
  readonly image: ImageForm | null;
  /** Equal for equal forms. */
  readonly key: string;
}

/** What is in a page, or has room in it; each range with an image has a layer. */
export interface PageSize {
  readonly vertices: number;
  readonly indices: number;
  readonly ranges: number;
}

/** What so much takes. */
export function pageFormBytes({ layout, image }: PageForm, { vertices, indices, ranges }: PageSize): number {
  return roomBytes(layout, vertices, indices) + (image === null ? 0 : ranges * image.bytes);
}

/** Buffers, and which segments lie where in them. */
export class Page {
  readonly mesh: PageMesh;
  readonly room: MeshRoom;
  /** Null for meshes without any. */
  readonly images: GpuImages | null;
  /** Which meshes it takes. */
  readonly form: PageForm;
  readonly size: PageSize;
  readonly ranges = new Set<PageRange>();
  /** Takes no further segment: it is being moved from, or is as large as what is moved into it. */
  isClosed = false;
  usedVertices = 0;
  usedIndices = 0;
  usedLayers = 0;
  readonly #store: GpuStore;
  readonly #material: GroundMaterial;
  readonly #facts: { map: ExternalTexture | null; hasTint: boolean; hasRegion: boolean; hasMeasure: boolean };
  #isWarm = false;

  constructor(store: GpuStore, form: PageForm, size: PageSize, material: GroundMaterial) {
    this.#store = store;
    this.form = form;
    this.size = size;
    this.room = new MeshRoom(store, form.layout, size.vertices, size.indices);
    this.images = form.image && store.createImages(form.image, size.ranges);
    const { room } = this;
    this.#material = material;
    this.#facts = {
      map: this.images && store.asTexture(this.images),
      hasTint: room.attributes.has("tint"),
      hasRegion: room.attributes.has("region"),
      hasMeasure: false,
    };
    this.mesh = new PageMesh(room.geometry(room.index!), material.paged);
    this.mesh.geometry.boundingSphere = new Sphere();
    this.mesh.onBeforeRender = (_renderer, _scene, camera: Camera) => this.#choose(camera);
    this.mesh.onBeforeShadow = (_renderer, _scene, _camera, light: Camera) => this.#choose(light);
    this.dress();
    // Drawn for one frame without a range, wherever one looks: three.js then makes its vertex array, and that is not left for
    // the frame of a swap.
    this.mesh.frustumCulled = false;
  }

  /** Whether it was drawn, be it without a range. */
  get isWarm(): boolean {
    return this.#isWarm;
  }

  /** Vertices and indices of what is in it. */
  live(): PageSize {
    let [vertices, indices] = [0, 0];
    for (const range of this.ranges) {
      vertices += range.vertexCount;
      indices += range.indices.length;
    }
    return { vertices, indices, ranges: this.ranges.size };
  }

  /** All that is allocated for it. */
  get bytes(): number {
    return pageFormBytes(this.form, this.size);
  }

  /** Of these, what something lives in. */
  get liveBytes(): number {
    return pageFormBytes(this.form, this.live());
  }

  /** Whether everything in it is on the GPU, and it is not being moved: only then it can be. */
  get canMove(): boolean {
    return !this.isClosed && [...this.ranges].every((range) => range.isWhole);
  }

  /** Whether so much more finds room behind what was ever put here. */
  hasRoom(vertexCount: number, indexCount: number): boolean {
    return (
      !this.isClosed &&
      this.ranges.size < MAX_RANGES &&
      (this.images === null || this.usedLayers < this.images.layers) &&
      this.usedVertices + vertexCount <= this.size.vertices &&
      this.usedIndices + indexCount <= this.size.indices
    );
  }

  /** Room for a mesh; whoever calls has asked {@link hasRoom}. */
  take(id: SegmentKey, data: MeshData): PageRange {
    const range = new PageRange(id, data, this, this.usedVertices, this.usedIndices);
    this.#put(range);
    return range;
  }

  /** Copy a range of another page of this form, and draw it from here; `image` is its image where it cannot be copied. Returns the bytes. */
  moveHere(range: PageRange, image: MeshImage | null): number {
    const from = range.page;
    const bytes = this.room.copyVertices(from.room, range.firstVertex, this.usedVertices, range.vertexCount);
    this.room.writeIndices(range.indices, this.usedIndices, this.usedVertices);
    let imageBytes = 0;
    if (from.images !== null && this.images !== null) {
      if (image !== null && "levels" in image.pixels) {
        const { pixels } = image;
        for (const level of pixels.levels.keys()) this.#store.writeLevel(this.images, this.usedLayers, pixels, level);
      } else {
        this.#store.copyImage(from.images, range.layer, this.images, this.usedLayers);
      }
      imageBytes = from.images.form.bytes;
    }
    from.ranges.delete(range);
    range.page = this;
    range.firstVertex = this.usedVertices;
    range.firstIndex = this.usedIndices;
    this.#put(range);
    from.look();
    this.look();
    return bytes + range.indices.byteLength + imageBytes;
  }

  /** The frame that drew it without a range is over. */
  endWarming(): void {
    this.#isWarm = true;
    this.mesh.frustumCulled = true;
    this.look();
  }

  /** After a change of what is shown of it: whether it is drawn, and what is out of sight. */
  look(): void {
    let sphere: Sphere | null = null;
    for (const range of this.ranges) {
      if (!range.isShown) continue;
      sphere = sphere === null ? this.mesh.geometry.boundingSphere!.copy(range.sphere) : sphere.union(range.sphere);
    }
    this.mesh.visible = sphere !== null || !this.#isWarm;
  }

  /** Show an attribute of the survey, or none. */
  setMeasure(name: string | null): void {
    const attribute = name === null ? undefined : this.room.measures.get(name);
    this.#facts.hasMeasure = attribute !== undefined;
    setMeasure(this.mesh.geometry, attribute);
  }

  /** After a change of what the ground takes part in. */
  dress(): void {
    this.#material.dress(this.mesh);
  }

  free(): void {
    this.mesh.removeFromParent();
    // Gives back three.js's vertex array alone: the buffers are the room's, the material is everybody's.
    this.mesh.geometry.dispose();
    this.room.free();
    if (this.images !== null) this.#store.freeImages(this.images);
    this.#facts.map?.dispose();
  }

  #put(range: PageRange): void {
    this.ranges.add(range);
    range.layer = this.usedLayers;
    this.usedLayers += 1;
    this.usedVertices += range.vertexCount;
    this.usedIndices += range.indices.length;
  }

  /** What of it this camera sees, and where its shader finds what differs. */
  #choose(camera: Camera): void {
    // In the frame of the ground, wherever that is.
    seen.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(this.mesh.matrixWorld);
    frustum.setFromProjectionMatrix(seen, camera.coordinateSystem, camera.reversedDepth);
    const { mesh } = this;
    const indexBytes = this.room.index!.elementSize;
    let count = 0;
    for (const range of this.ranges) {
      if (!range.isShown || !frustum.intersectsSphere(range.sphere)) continue;
      mesh._multiDrawStarts[count] = range.firstIndex * indexBytes;
      mesh._multiDrawCounts[count] = range.indices.length;
      traits.set(range.traits, count * TRAITS);
      count += 1;
    }
    mesh._multiDrawCount = count;
    // Sent at once, so one array will do for all pages; no more of it than is drawn.
    this.#material.bindPage(this.#facts, traits.subarray(0, Math.max(count, 1) * TRAITS), mesh, camera);
  }
}

/** A mesh to compile the pages' program by, before there is a page. */
export function emptyPage(material: GroundMaterial): PageMesh {
  const mesh = new PageMesh(new BufferGeometry(), material.paged);
  mesh.visible = false;
  return mesh;
}

const seen = new Matrix4();
const frustum = new Frustum();
const traits = new Float32Array(TRAITS * MAX_RANGES);
