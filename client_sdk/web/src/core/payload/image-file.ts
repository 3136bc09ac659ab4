/** The image file inside a payload: its header is checked before anything decodes it. */

import type { CompressedImage, MeshImage } from "../types.ts";
import { PayloadError } from "./errors.ts";
import type { ImageHeader } from "./image-header.ts";
import { readImageHeader } from "./image-header.ts";

/** Decodes an image file; in a browser by `createImageBitmap`, KTX2 by a transcoder. */
export type DecodeImage = (bytes: Uint8Array<ArrayBuffer>, mediaType: string) => Promise<ImageBitmap | CompressedImage>;

/** An image file whose header was checked. */
export interface ImageFile {
  readonly header: ImageHeader;
  readonly bytes: Uint8Array<ArrayBuffer>;
}

/** 2^26: what 4096 x 4096 pixels take uncompressed. */
export const MAX_IMAGE_BYTES = 2 ** 26;

/**
 * Check the header of an image file.
 *
 * @param mediaType As the payload says it.
 * @param maxSide Pixels of the longer side.
 * @throws PayloadError If the file is of another type, or its sides are not powers of two or too large.
 */
export function checkedImage(bytes: Uint8Array<ArrayBuffer>, mediaType: unknown, maxSide: number): ImageFile {
  const header = readImageHeader(bytes);
  const { width, height } = header;
  if (header.mediaType !== mediaType) {
    throw new PayloadError(`image is ${header.mediaType}, expected ${mediaType} by the payload`);
  }
  for (const side of [width, height]) {
    if (side < 1 || side > maxSide || (side & (side - 1)) !== 0) {
      throw new PayloadError(`image of ${width} x ${height} pixels, expected powers of two, at most ${maxSide}`);
    }
  }
  return { header, bytes };
}

/**
 * Decode the pixels.
 *
 * @throws PayloadError If the file does not decode, or to other sides than its header has.
 */
export async function openImage({ header, bytes }: ImageFile, decodeImage: DecodeImage): Promise<MeshImage> {
  let pixels: ImageBitmap | CompressedImage;
  try {
    pixels = await decodeImage(bytes, header.mediaType);
  } catch {
    throw new PayloadError(`image does not decode, expected a whole ${header.mediaType}`);
  }
  if (pixels.width !== header.width || pixels.height !== header.height) {
    if ("close" in pixels) pixels.close();
    throw new PayloadError(`image of ${pixels.width} x ${pixels.height} pixels, its header says otherwise`);
  }
  return { ...header, pixels };
}
