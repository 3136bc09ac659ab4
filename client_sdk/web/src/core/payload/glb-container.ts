/** GLB's outer form: header, JSON chunk, BIN chunk (glTF 2.0 specification, section 4.4). */

import { PayloadError } from "./errors.ts";
import type { JsonObject } from "./json-values.ts";
import { expectObject } from "./json-values.ts";

/** Bounds the parser's work on hostile bytes; our own documents have 2-4 KiB. */
const MAX_JSON_BYTES = 2 ** 20;
const HEADER_BYTES = 12;
const CHUNK_BYTES = 8;
// As little-endian numbers.
const GLTF = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const BIN_CHUNK = 0x004e4942;

/** The two chunks of a GLB. */
export interface Glb {
  /** Parsed JSON, of whatever shape the file gave it: each reader checks the members that it takes. */
  readonly gltf: JsonObject;
  /** A view of the payload. */
  readonly binary: Uint8Array<ArrayBuffer>;
  /** Where the BIN chunk's contents start in the payload, bytes. */
  readonly binaryOffset: number;
}

/**
 * Read a GLB's two chunks; safe on hostile bytes.
 *
 * @throws PayloadError With the offset: wrong magic, version or length, a chunk of another type or beyond the end, JSON
 * that does not parse to an object or is larger than 1 MiB.
 */
export function splitGlb(bytes: Uint8Array<ArrayBuffer>): Glb {
  const size = bytes.length;
  if (size < HEADER_BYTES + CHUNK_BYTES) {
    throw new PayloadError(`${size} bytes, expected a GLB of at least ${HEADER_BYTES + CHUNK_BYTES}`, 0);
  }
  const view = new DataView(bytes.buffer, bytes.byteOffset, size);
  if (view.getUint32(0, true) !== GLTF) throw new PayloadError("no magic glTF at the start", 0);
  const version = view.getUint32(4, true);
  if (version !== 2) throw new PayloadError(`glTF version ${version}, expected 2`, 4);
  const length = view.getUint32(8, true);
  if (length !== size) throw new PayloadError(`${size} bytes, expected ${length} by the header`, 8);

  const text = chunkAt(bytes, view, HEADER_BYTES, JSON_CHUNK, "JSON");
  if (text.length > MAX_JSON_BYTES) {
    throw new PayloadError(`JSON chunk of ${text.length} bytes, expected at most ${MAX_JSON_BYTES}`, HEADER_BYTES);
  }
  const textOffset = HEADER_BYTES + CHUNK_BYTES;
  const binaryOffset = textOffset + text.length + CHUNK_BYTES;
  const binary = chunkAt(bytes, view, textOffset + text.length, BIN_CHUNK, "BIN");
  const end = binaryOffset + binary.length;
  if (end !== size) throw new PayloadError(`${size - end} bytes after the BIN chunk, expected none`, end);
  return { gltf: parse(text, textOffset), binary, binaryOffset };
}

function chunkAt(
  bytes: Uint8Array<ArrayBuffer>,
  view: DataView,
  at: number,
  kind: number,
  name: string,
): Uint8Array<ArrayBuffer> {
  const remainingBytes = bytes.length - at - CHUNK_BYTES;
  if (remainingBytes < 0)
    throw new PayloadError(`${remainingBytes + CHUNK_BYTES} bytes left, expected a ${name} chunk`, at);
  const actualKind = view.getUint32(at + 4, true);
  if (actualKind !== kind) throw new PayloadError(`chunk type 0x${actualKind.toString(16)}, expected ${name}`, at + 4);
  const length = view.getUint32(at, true);
  if (length > remainingBytes) throw new PayloadError(`chunk of ${length} bytes, ${remainingBytes} left`, at);
  return bytes.subarray(at + CHUNK_BYTES, at + CHUNK_BYTES + length);
}

function parse(text: Uint8Array, offset: number): JsonObject {
  let gltf: unknown;
  try {
    gltf = JSON.parse(new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(text));
  } catch {
    throw new PayloadError("JSON chunk does not parse", offset);
  }
  return expectObject(gltf, "JSON chunk");
}
