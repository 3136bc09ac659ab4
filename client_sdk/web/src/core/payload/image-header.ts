/**
 * What an image file says of itself, read without decoding it.
 *
 * Nobody may hand an image library fifty bytes that claim 65535 x 65535 pixels. Formats: JPEG (ITU-T T.81, annex B), PNG
 * (ISO 15948, 5.2 and 11.2.2), WebP (RFC 9649, 2.3 to 2.7), KTX2 (Khronos KTX File Format 2.0, section 3).
 */

import { PayloadError } from "./errors.ts";

/** What a payload's image may be. */
export type MediaType = "image/jpeg" | "image/ktx2" | "image/png" | "image/webp";

/** Type and sides, by the file's own header. */
export interface ImageHeader {
  readonly mediaType: MediaType;
  /** Pixels; not checked against any limit. */
  readonly width: number;
  readonly height: number;
}

const JPEG = [0xff, 0xd8, 0xff];
const PNG = [0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a];
const KTX2 = [0xab, 0x4b, 0x54, 0x58, 0x20, 0x32, 0x30, 0xbb, 0x0d, 0x0a, 0x1a, 0x0a];

/**
 * Read an image file's header; safe on hostile bytes.
 *
 * @throws PayloadError If the first bytes are of none of the four types, or the header is cut short.
 */
export function readImageHeader(bytes: Uint8Array): ImageHeader {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  try {
    if (startsWith(bytes, JPEG)) return { mediaType: "image/jpeg", ...jpegSides(view) };
    if (startsWith(bytes, PNG)) {
      if (letters(view, 12) !== "IHDR") throw new PayloadError("PNG does not start with IHDR");
      return { mediaType: "image/png", width: view.getUint32(16), height: view.getUint32(20) };
    }
    if (startsWith(bytes, KTX2)) {
      return { mediaType: "image/ktx2", width: view.getUint32(20, true), height: view.getUint32(24, true) };
    }
    if (bytes.length >= 12 && letters(view, 0) === "RIFF" && letters(view, 8) === "WEBP") {
      return { mediaType: "image/webp", ...webpSides(view) };
    }
  } catch (error) {
    // A DataView's own: read beyond the end.
    if (error instanceof RangeError) throw new PayloadError(`image header cut short after ${bytes.length} bytes`);
    throw error;
  }
  throw new PayloadError("image of unknown type, expected JPEG, PNG, WebP or KTX2 by its first bytes");
}

type Sides = Pick<ImageHeader, "width" | "height">;

function jpegSides(view: DataView): Sides {
  let at = 2;
  // Each round moves on by a byte or more.
  while (at + 4 <= view.byteLength) {
    if (view.getUint8(at) !== 0xff) throw new PayloadError(`JPEG without a marker at ${at}`);
    const marker = view.getUint8(at + 1);
    if (marker === 0xff) {
      at += 1; // a fill byte
    } else if (marker === 0x01 || (marker >= 0xd0 && marker <= 0xd7)) {
      at += 2; // TEM and the restarts have no length
    } else if (marker === 0xd9 || marker === 0xda) {
      break;
    } else if (marker >= 0xc0 && marker <= 0xcf && marker !== 0xc4 && marker !== 0xc8 && marker !== 0xcc) {
      return { height: view.getUint16(at + 5), width: view.getUint16(at + 7) }; // DHT, JPG, DAC lie between the frames
    } else {
      at += 2 + Math.max(view.getUint16(at + 2), 2);
    }
  }
  throw new PayloadError("JPEG without a frame header before its first scan");
}

function webpSides(view: DataView): Sides {
  const kind = letters(view, 12);
  if (kind === "VP8 ") {
    return { width: view.getUint16(26, true) & 0x3fff, height: view.getUint16(28, true) & 0x3fff };
  }
  if (kind === "VP8L") {
    const bits = view.getUint32(21, true);
    return { width: (bits & 0x3fff) + 1, height: ((bits >> 14) & 0x3fff) + 1 };
  }
  if (kind === "VP8X") {
    const three = (at: number) => view.getUint16(at, true) | (view.getUint8(at + 2) << 16);
    return { width: three(24) + 1, height: three(27) + 1 };
  }
  throw new PayloadError("WebP without VP8, VP8L or VP8X as its first chunk");
}

function startsWith(bytes: Uint8Array, start: readonly number[]): boolean {
  return bytes.length >= start.length && start.every((byte, at) => bytes[at] === byte);
}

function letters(view: DataView, at: number): string {
  return String.fromCharCode(view.getUint8(at), view.getUint8(at + 1), view.getUint8(at + 2), view.getUint8(at + 3));
}
