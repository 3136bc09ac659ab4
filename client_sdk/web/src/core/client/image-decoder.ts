/** Pictures inside payloads, decoded where this runs. */

import type { DecodeImage } from "../payload/image-file.ts";
import { decodeBasis } from "./basis-decoder.ts";

/** The platform's decoder, giving the picture's own values; undefined where there is none (Node). */
export function imageDecoder(): DecodeImage | undefined {
  if (typeof createImageBitmap !== "function") return undefined;
  return (bytes, mediaType) =>
    mediaType === "image/ktx2"
      ? decodeBasis(bytes)
      : createImageBitmap(new Blob([bytes], { type: mediaType }), {
          colorSpaceConversion: "none",
          premultiplyAlpha: "none",
        });
}
