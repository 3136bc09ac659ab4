/**
 * All pages of a stage: where a segment finds room, and which pages are moved together.
 *
 * A page is as large as what its landing still brings of its form, and is never added to behind its end. What leaves it leaves
 * its room behind, so pages less than half alive are moved together, and so are small ones of like size, which aims leave. Each move is
 * one segment, copied on the GPU and drawn from its new place in the same frame: the picture is the same before and after.
 */

import type { Group } from "three";

import { gpuBytesOf, MAX_PAGE_VERTICES, pageBytes } from "../core/gpu-budget.ts";
import type { MeshData, SegmentKey } from "../core/types.ts";
import { type GpuStore, imageFormOf } from "./gpu-store.ts";
import type { GroundMaterial } from "./ground-material.ts";
import { MAX_RANGES } from "./ground-shader.ts";
import { layoutOf, type VertexPart } from "./mesh-room.ts";
import { Page, type PageForm, type PageRange, type PageSize, pageFormBytes } from "./page.ts";
import { type ImageOf, PageMove } from "./page-move.ts";

/** Pages with less of their bytes alive are moved (docs/decisions/web-rendering.md: 1.4 to 1.5 times the room, 0.3 bytes moved for each uploaded). */
const LEAST_LIVE_SHARE = 0.5;
/** A page joins others of its form where it is at most so many times as large as they together: it grows by half at least. */
const MOST_TIMES_LARGER = 2;

/** Of a compressed image that is moved: a few milliseconds of one frame. */
const MAX_MOVED_IMAGE_BYTES = 1024 * 1024;
/** Forms that are counted; beyond it the counts begin anew. */
const MAX_FORMS = 64;

/** How large a mesh is that is still to come. */
export interface ComingMesh {
  readonly vertices: number;
  readonly faces: number;
}

/** See the head of the file. Freed by `freeAll`, or range by range. */
export class Pages {
  readonly #parent: Group;
  readonly #store: GpuStore;
  readonly #material: GroundMaterial;
  readonly #maxBytes: number;
  readonly #imageOf: ImageOf;
  readonly #pages = new Set<Page>();
  /** Of what shapes segments came, so that as many are made room for as will come of each. */
  readonly #forms = new FormCounts();
  #measureName: string | null = null;
  #move: PageMove | null = null;
  /** Whether something left or came since the last look for what is to be moved. */
  #isChanged = false;

  /** @param maxBytes Most bytes of the whole store; beyond it pages are moved together however much of them is alive. */
  constructor(parent: Group, store: GpuStore, material: GroundMaterial, maxBytes: number, imageOf: ImageOf) {
    this.#parent = parent;
    this.#store = store;
    this.#material = material;
    this.#maxBytes = maxBytes;
    this.#imageOf = imageOf;
  }

  get count(): number {
    return this.#pages.size;
  }

  /** Pages that were not drawn yet. */
  get coldCount(): number {
    return [...this.#pages].filter((page) => !page.isWarm).length;
  }

  /** Whether `tidy` may have something to do. */
  get isUntidy(): boolean {
    return this.#isChanged || this.#move !== null;
  }

  /**
   * Room for a mesh, in a page that is as large as what comes after it of its landing. Null where other pages have to be moved
   * together before: `tidy` does it.
   */
  reserve(
    id: SegmentKey,
    data: MeshData,
    parts: readonly VertexPart[],
    coming: () => readonly ComingMesh[],
  ): PageRange | null {
    const { vertexCount, indices } = data;
    const form = pageFormOf(data, parts);
    for (const page of this.#pages) {
      if (page.form.key === form.key && page.hasRoom(vertexCount, indices.length)) {
        this.#forms.count(form.key);
        return page.take(id, data);
      }
    }
    const { bufferBytes, textureBytes } = this.#store;
    const left = this.#maxBytes - pageBytes(form.layout.vertexBytes) - bufferBytes - textureBytes;
    if (gpuBytesOf(data) > left && (this.#move !== null || this.#startMove(this.#mostWasteful()))) return null;
    this.#forms.count(form.key);
    const own = { vertices: vertexCount, indices: indices.length, ranges: 1 };
    return this.#make(form, this.#sizeFor(form, own, coming(), left)).take(id, data);
  }

  /** Room for a mesh and for what comes after it in the same form: as large as it is known to be. */
  #sizeFor(form: PageForm, own: PageSize, coming: readonly ComingMesh[], left: number): PageSize {
    // What is compressed is written at once where it is moved to: a large image has a page to itself, which is never moved.
    if (form.image !== null && form.image.extension !== null && form.image.bytes > MAX_MOVED_IMAGE_BYTES) return own;
    const count = Math.round(coming.length * this.#forms.shareOf(form.key));
    let size = own;
    for (const { vertices, faces } of coming.slice(0, count)) {
      const more = {
        vertices: size.vertices + vertices,
        indices: size.indices + 3 * faces,
        ranges: size.ranges + 1,
      };
      if (more.vertices > MAX_PAGE_VERTICES || more.ranges > MAX_RANGES || pageFormBytes(form, more) > left) break;
      size = more;
    }
    return size;
  }

  /** A range is whole: its page may be moved from now on. */
  completed(range: PageRange): void {
    range.isWhole = true;
    range.page.look();
    this.#isChanged = true;
  }

  /** Give a range back. Its page goes with its last. */
  release(range: PageRange): void {
    const { page } = range;
    page.ranges.delete(range);
    if (page.ranges.size > 0 || page === this.#move?.to) page.look();
    else this.#free(page);
    this.#isChanged = true;
  }

  /** One step of moving pages together, if there is anything to move. Returns its bytes, or 0. */
  tidy(): number {
    if (this.#move === null) {
      if (!this.#isChanged) return 0;
      this.#isChanged = this.#startMove(this.#sparse());
      if (this.#move === null) return 0;
      return 1;
    }
    const bytes = this.#move.step();
    for (const page of this.#pages) if (page.ranges.size === 0 && page !== this.#move.to) this.#free(page);
    if (this.#move.isDone) this.#endMove();
    return bytes;
  }

  /** Ids mean other segments from now on: what is shown stays where it is. */
  leaveVersion(): void {
    for (const page of this.#pages) page.isClosed = true;
    if (this.#move?.to.ranges.size === 0) this.#free(this.#move.to);
    this.#move = null;
  }

  /** What was new in the last frame was drawn. */
  endWarming(): void {
    for (const page of this.#pages) if (!page.isWarm) page.endWarming();
  }

  /** For every page, and those to come. */
  setMeasure(name: string | null): void {
    this.#measureName = name;
    for (const page of this.#pages) page.setMeasure(name);
  }

  /** After a change of what the ground takes part in. */
  dress(): void {
    for (const page of this.#pages) page.dress();
  }

  /** Everything at once: what WebGL lost, or at the end. Ranges must be forgotten with it. */
  freeAll(): void {
    for (const page of [...this.#pages]) this.#free(page);
    this.#move = null;
    this.#isChanged = false;
  }

  #make(form: PageForm, size: PageSize): Page {
    const page = new Page(this.#store, form, size, this.#material);
    page.setMeasure(this.#measureName);
    this.#pages.add(page);
    this.#parent.add(page.mesh);
    return page;
  }

  /** Pages of one form that are to become one: none where all is in order. */
  #sparse(): Page[] {
    const byForm = new Map<string, Page[]>();
    for (const page of this.#pages) {
      if (page.canMove) byForm.set(page.form.key, [...(byForm.get(page.form.key) ?? []), page]);
    }
    for (const pages of byForm.values()) {
      const sparse = pages.filter((page) => page.liveBytes < LEAST_LIVE_SHARE * page.bytes);
      const chosen = fitting(sparse.length > 0 ? sparse : alike(pages));
      if (chosen.length > 0) return chosen;
    }
    return [];
  }

  /** The page with most room for nothing. */
  #mostWasteful(): Page[] {
    let [most, found]: [number, Page | null] = [0, null];
    for (const page of this.#pages) {
      const waste = page.canMove ? page.bytes - page.liveBytes : 0;
      if (waste > most) [most, found] = [waste, page];
    }
    return found === null ? [] : [found];
  }

  /** False where there is nothing to move. */
  #startMove(from: Page[]): boolean {
    const first = from[0];
    if (first === undefined) return false;
    const live = from.map((page) => page.live());
    const sum = (of: (one: PageSize) => number): number => live.reduce((total, one) => total + of(one), 0);
    const to = this.#make(first.form, {
      vertices: sum((one) => one.vertices),
      indices: sum((one) => one.indices),
      ranges: sum((one) => one.ranges),
    });
    this.#move = new PageMove(from, to, this.#imageOf);
    return true;
  }

  #endMove(): void {
    const { to } = this.#move!;
    to.isClosed = false;
    if (to.ranges.size === 0) this.#free(to);
    this.#move = null;
  }

  #free(page: Page): void {
    this.#pages.delete(page);
    page.free();
  }
}

/** How many meshes of each form there were. */
class FormCounts {
  readonly #counts = new Map<string, number>();
  #total = 0;

  count(key: string): void {
    if (this.#counts.size === MAX_FORMS && !this.#counts.has(key)) {
      this.#counts.clear();
      this.#total = 0;
    }
    this.#counts.set(key, (this.#counts.get(key) ?? 0) + 1);
    this.#total += 1;
  }

  shareOf(key: string): number {
    return (this.#counts.get(key) ?? 0) / this.#total;
  }
}

function pageFormOf(data: MeshData, parts: readonly VertexPart[]): PageForm {
  const layout = layoutOf(parts, data.indices);
  const image = data.image && imageFormOf(data.image);
  return { layout, image, key: `${layout.key}, ${image?.key}` };
}

/**
 * Pages of one form that are small, and of like size: at least two, or none. So one of `n` segments was copied `log n` times at
 * most, and as few pages are left.
 */
function alike(pages: readonly Page[]): Page[] {
  const sizes = pages
    .map((page) => ({ page, ...page.live() }))
    .filter(({ vertices, ranges }) => 2 * vertices <= MAX_PAGE_VERTICES && 2 * ranges <= MAX_RANGES)
    .sort((a, b) => a.vertices - b.vertices);
  for (let first = 0; first + 1 < sizes.length; first += 1) {
    let sum = sizes[first]!.vertices;
    let end = first + 1;
    for (; end < sizes.length && sizes[end]!.vertices <= MOST_TIMES_LARGER * sum; end += 1) sum += sizes[end]!.vertices;
    if (end > first + 1) return sizes.slice(first, end).map(({ page }) => page);
  }
  return [];
}

/** As many of these as become one page, the smallest first. */
function fitting(pages: Page[]): Page[] {
  const sizes = new Map(pages.map((page) => [page, page.live().vertices]));
  let [vertices, ranges] = [0, 0];
  return pages
    .sort((a, b) => sizes.get(a)! - sizes.get(b)!)
    .filter((page) => {
      vertices += sizes.get(page)!;
      ranges += page.ranges.size;
      return vertices <= MAX_PAGE_VERTICES && ranges <= MAX_RANGES;
    });
}
