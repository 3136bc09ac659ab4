/** The compiled parts of decoding: meshoptimizer's decoder and XXH3. Everything else needs them ready. */

/** Make the decoders ready; call it once before any decoding, as often as you like. */
export function prepareDecoders(): Promise<void> {
  throw new Error("on its way");
}

/** XXH3-64, seed 0, as a number. Needs `prepareDecoders`. */
export function xxh3(_bytes: Uint8Array): bigint {
  throw new Error("on its way");
}
