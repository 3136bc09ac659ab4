/** base.cover: which segments lie over each base face (scene format, section 8). */

import type { Cover } from "../types.ts";

/**
 * Read `base.cover`; every truncation and flipped bit is noticed. Needs `prepareDecoders`.
 *
 * @param baseFaces Faces of the base mesh; the cover has one row for each.
 * @throws PayloadError
 */
export function decodeCover(_bytes: Uint8Array<ArrayBuffer>, _baseFaces: number): Cover {
  throw new Error("on its way");
}
