/**
 * What lives in some pages on its way into one: a segment a step, drawn from its new place in the same frame.
 *
 * Vertices and drawable images are copied on the GPU, indices written anew. A compressed image a GPU can only read: it is decoded
 * once more from its payload. Where that is gone, its page stays as it is.
 */

import type { MeshImage, SegmentKey } from "../core/types.ts";
import { imageFormOf } from "./gpu-store.ts";
import type { Page, PageRange } from "./page.ts";

/** The image of a payload that is here, once more; null where it cannot be had. */
export type ImageOf = (id: SegmentKey) => Promise<MeshImage | null>;

/** One move. `step` until `isDone`. */
export class PageMove {
  readonly to: Page;
  readonly #from: Page[];
  readonly #imageOf: ImageOf;
  /** The range whose image was asked for. */
  #asked: PageRange | null = null;
  #image: MeshImage | "none" | null = null;

  /** @param to As large as what lives in the others, of which none is empty. Nothing else may be put there meanwhile. */
  constructor(from: readonly Page[], to: Page, imageOf: ImageOf) {
    this.to = to;
    this.#from = [...from];
    this.#imageOf = imageOf;
    for (const page of [...from, to]) page.isClosed = true;
  }

  get isDone(): boolean {
    return this.#from.every((page) => page.ranges.size === 0);
  }

  /** Move one segment. Returns its bytes; 0 while its image is decoded. */
  step(): number {
    const page = this.#from.find(({ ranges }) => ranges.size > 0);
    const [range] = page?.ranges ?? [];
    if (page === undefined || range === undefined) return 0;
    if (page.images === null || page.images.form.extension === null) return this.to.moveHere(range, null);
    if (this.#asked !== range) this.#ask(range);
    const image = this.#image;
    if (image === null) return 0;
    if (image !== "none" && imageFormOf(image).key === page.images.form.key) return this.to.moveHere(range, image);
    this.#from.splice(this.#from.indexOf(page), 1);
    return 1;
  }

  #ask(range: PageRange): void {
    const take = (image: MeshImage | null): void => {
      if (this.#asked === range) this.#image = image ?? "none";
    };
    this.#asked = range;
    this.#image = null;
    this.#imageOf(range.id).then(take, () => take(null));
  }
}
