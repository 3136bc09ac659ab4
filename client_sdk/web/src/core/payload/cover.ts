/** base.cover: which segments lie over each base face (scene format, section 8). */

import type { Cover } from "../types.ts";
import { PayloadError } from "./errors.ts";
import type { FlatFile } from "./flat.ts";
import { decodeFlat } from "./flat.ts";

/**
 * Read `base.cover`; every truncation and flipped bit is noticed. Needs `prepareDecoders`.
 *
 * The arrays are copies, so that they can be handed to another thread, and the file let go.
 *
 * @param baseFaces Faces of the base mesh; the cover has one row for each.
 * @throws PayloadError
 */
export function decodeCover(bytes: Uint8Array<ArrayBuffer>, baseFaces: number): Cover {
  const file = decodeFlat(bytes, "TPCOVER1");
  const offsets = columnOf(file, "offsets");
  const segments = columnOf(file, "segments");
  if (file.rows !== baseFaces || offsets.length !== baseFaces + 1) {
    const rows = offsets.length - 1;
    throw new PayloadError(`cover of ${rows} rows (header: ${file.rows}), expected ${baseFaces}: one a base face`);
  }
  if (offsets[0] !== 0 || offsets[baseFaces] !== segments.length) {
    throw new PayloadError(
      `cover offsets run ${offsets[0]} to ${offsets[baseFaces]}, expected 0 to ${segments.length}`,
    );
  }
  checkOffsets(offsets);
  checkRowsAscend(offsets, segments);
  return { offsets: offsets.slice(), segments: segments.slice() };
}

function columnOf(file: FlatFile, name: string): Uint32Array {
  const field = file.fields.get(name);
  if (field?.values instanceof Uint32Array && field.components === 1) return field.values;
  throw new PayloadError(`no field ${name} of uint32 in the cover`);
}

/** All of them before any row is read: until then an offset may point anywhere. */
function checkOffsets(offsets: Uint32Array): void {
  for (let face = 1; face < offsets.length; face += 1) {
    if (offsets[face]! < offsets[face - 1]!) {
      throw new PayloadError(`cover offsets decrease at base face ${face - 1}, expected ascending`);
    }
  }
}

function checkRowsAscend(offsets: Uint32Array, segments: Uint32Array): void {
  for (let face = 0; face + 1 < offsets.length; face += 1) {
    for (let at = offsets[face]! + 1; at < offsets[face + 1]!; at += 1) {
      if (segments[at]! <= segments[at - 1]!) {
        throw new PayloadError(`segments over base face ${face} do not ascend, expected each once, ascending`);
      }
    }
  }
}
