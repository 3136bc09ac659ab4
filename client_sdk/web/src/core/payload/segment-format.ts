/** Segments in segment format 2 (spec/segment-format.md) to what the GPU is given. */

import type { AttributeScale, Bounds, MeshData } from "../types.ts";
import { crc32 } from "./crc32.ts";
import { PayloadError } from "./errors.ts";
import { inflate } from "./gzip.ts";
import { checkedImage, type DecodeImage, type ImageFile, MAX_IMAGE_BYTES, openImage } from "./image-file.ts";
import { boundsOf, largest, transformedBounds } from "./mesh-checks.ts";
import { countBits, isSet, Planes } from "./planes.ts";
import { linearColours, unfoldedNormals } from "./vertex-codes.ts";

/** "TSG2", little-endian. */
const MAGIC = 0x32475354;
const OUTER_BYTES = 12;
const HEAD_BYTES = 40;
const MAX_STREAM_BYTES = 2 ** 28;
const [COLOURS, UVS, REGIONS] = [1, 2, 4];
const MEDIA_TYPES = ["", "image/jpeg", "image/png", "image/webp", "image/ktx2"];
/** Pixels of the image's longer side. */
const MAX_SIDE = 2048;
const NO_REGION = 0xffff;
/** Float32 holds every whole number of steps below it. */
const MAX_STEPS = 2 ** 24;

/**
 * Decode one segment. The mesh has no image without `decodeImage`. `bytes` are only read.
 *
 * @param attributes Of the manifest of the segment's version.
 * @throws PayloadError For anything that is not a whole segment.
 */
export async function decodeSegment(
  bytes: Uint8Array<ArrayBuffer>,
  segment: number,
  attributes: readonly AttributeScale[],
  decodeImage?: DecodeImage,
): Promise<MeshData> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  if (bytes.length < OUTER_BYTES || view.getUint32(0, true) !== MAGIC) {
    throw new PayloadError(`${bytes.length} bytes without magic TSG2, expected a segment`, 0);
  }
  const end = OUTER_BYTES + view.getUint32(4, true);
  const imageBytes = view.getUint32(8, true);
  if (end + imageBytes !== bytes.length || imageBytes > MAX_IMAGE_BYTES) {
    throw new PayloadError(`${bytes.length} bytes, expected ${end} and an image of ${imageBytes}`, 4);
  }
  const stream = await inflate(bytes.subarray(OUTER_BYTES, end), MAX_STREAM_BYTES);
  const { mesh, image } = readStream(stream, bytes.subarray(end), segment, attributes);
  return image === null || decodeImage === undefined ? mesh : { ...mesh, image: await openImage(image, decodeImage) };
}

/** Read head and planes. */
function readStream(
  stream: Uint8Array<ArrayBuffer>,
  imageBytes: Uint8Array<ArrayBuffer>,
  segment: number,
  attributes: readonly AttributeScale[],
): { mesh: MeshData; image: ImageFile | null } {
  // (1) The head. The lengths that it leads to must be the stream's, before anything is reserved for them.
  if (stream.length < HEAD_BYTES) throw new PayloadError(`stream of ${stream.length} bytes, expected a head`);
  const head = new DataView(stream.buffer);
  const [vertexCount, faceCount] = [head.getUint32(0, true), head.getUint32(4, true)];
  const [flags, kind, mask] = [head.getUint8(21), head.getUint8(22), head.getUint32(32, true)];
  const hasBoth = (flags & COLOURS) !== 0 && (flags & UVS) !== 0;
  if (vertexCount < 1 || faceCount < 1 || flags > 7 || hasBoth || kind >= MEDIA_TYPES.length) {
    throw new PayloadError(`${vertexCount} vertices, ${faceCount} faces, flags ${flags}, image ${kind}`);
  }
  if (mask >= 2 ** attributes.length) {
    throw new PayloadError(`attributes ${mask.toString(2)}, expected of the scene's ${attributes.length}`);
  }
  const held = attributes.filter((_, bit) => Math.floor(mask / 2 ** bit) % 2 === 1);
  const planes = new Planes(stream, HEAD_BYTES);
  const [starts, lefts] = [planes.bits(faceCount), planes.bits(faceCount)];
  const nameCount = faceCount + 2 * countBits(starts, faceCount);
  const news = planes.bits(nameCount);
  const oldCount = nameCount - vertexCount;
  const oldWidth = vertexCount <= 65536 ? 2 : 4;
  const vertexBytes = 8 + (flags & COLOURS && 3) + (flags & UVS && 4) + (flags & REGIONS && 2) + 2 * held.length;
  if (oldCount < 0 || planes.left !== oldWidth * oldCount + vertexBytes * vertexCount) {
    throw new PayloadError(`${planes.left} bytes of planes for ${oldCount} corners and ${vertexCount} vertices`);
  }
  // (2) Faces.
  const old = planes.differences(new (oldWidth === 2 ? Uint16Array : Uint32Array)(oldCount), oldWidth);
  const indices = new (vertexCount < 65536 ? Uint16Array : Uint32Array)(3 * faceCount);
  const newCount = readFaces(starts, lefts, news, old, indices);
  if (newCount !== vertexCount) throw new PayloadError(`${newCount} vertices in faces, expected ${vertexCount}`);
  // (3) Vertices.
  const plane = () => planes.differences(new Uint8Array(vertexCount), 1);
  const codes = () => planes.differences(new Uint16Array(2 * vertexCount), 2, 0, 2);
  const positions = new Uint16Array(4 * vertexCount);
  for (const axis of [0, 1, 2]) planes.differences(positions, 2, axis, 4);
  const normals = unfoldedNormals(plane(), plane());
  const colours = flags & COLOURS ? linearColours(plane(), plane(), plane()) : null;
  const uvs = flags & UVS ? codes() : null;
  if (uvs !== null) planes.differences(uvs, 2, 1, 2);
  const region = head.getUint16(24, true);
  const oneRegion = region === NO_REGION ? null : new Uint16Array(2 * vertexCount).fill(region);
  const regionIds = flags & REGIONS ? codes() : oneRegion;
  const place = placeOf(head, boundsOf(positions));
  const [width, height] = [head.getUint16(26, true), head.getUint16(28, true)];
  const mesh: MeshData = {
    segment,
    vertexCount,
    faceCount,
    ...place,
    positions,
    normals,
    colours,
    uvs,
    uvScale: uvs === null ? [1, 1] : [0.5 / width, 0.5 / height],
    regionIds,
    attributes: held.map(({ name, offset, step }) => ({ name, offset, step, codes: codes() })),
    indices,
    image: null,
  };
  // (4) The image.
  const hasImage = imageBytes.length > 0;
  if (hasImage !== kind > 0 || hasImage !== (uvs !== null) || crc32(imageBytes) !== head.getUint32(36, true)) {
    throw new PayloadError("image is damaged or missing, or has no texture coordinates");
  }
  if (uvs === null) return { mesh, image: null };
  const image = checkedImage(imageBytes, MEDIA_TYPES[kind], MAX_SIDE);
  if (image.header.width !== width || image.header.height !== height) {
    throw new PayloadError(`image of ${width} x ${height} pixels by the head, its own header says otherwise`);
  }
  if (largest(uvs, 0, 2) > 2 * width || largest(uvs, 1, 2) > 2 * height) {
    throw new PayloadError("texture coordinates beyond the image, expected 0 to 1");
  }
  return { mesh, image };
}

/** Fill in the faces' corners; returns how many vertices they name. */
function readFaces(
  starts: Uint8Array,
  lefts: Uint8Array,
  news: Uint8Array,
  old: Uint16Array | Uint32Array,
  indices: Uint16Array | Uint32Array,
): number {
  if (!isSet(starts, 0)) throw new PayloadError("the first face continues a strip, expected a start");
  let [fresh, name, first, second, third] = [0, 0, 0, 0, 0];
  for (let at = 0, face = 0; at < indices.length; at += 3, face += 1) {
    const isStart = isSet(starts, face);
    if (isSet(lefts, face)) second = third;
    else first = third;
    // A start names three corners, which move up; any other face its third alone.
    for (let corner = isStart ? 0 : 2; corner < 3; corner += 1, name += 1) {
      if (isStart) {
        first = second;
        second = third;
      }
      third = isSet(news, name) ? fresh++ : old[name - fresh]!;
      if (!(third < fresh)) throw new PayloadError(`corner ${name} is vertex ${third}, expected below ${fresh}`);
    }
    indices[at] = first;
    indices[at + 1] = second;
    indices[at + 2] = third;
  }
  return fresh;
}

/** Where codes are, and their box in metres. */
function placeOf(head: DataView, codes: Bounds): Pick<MeshData, "translation" | "stepM" | "bounds"> {
  const origin = [head.getInt32(8, true), head.getInt32(12, true), head.getInt32(16, true)] as const;
  if (origin.some((steps, axis) => Math.max(-steps, steps + codes[axis + 3]!) >= MAX_STEPS)) {
    throw new PayloadError("a position 2^24 steps or more from the scene's origin, expected less");
  }
  const stepM = 2 ** head.getInt8(20);
  const translation = [origin[0] * stepM, origin[1] * stepM, origin[2] * stepM] as const;
  return { translation, stepM, bounds: transformedBounds(codes, { translation, stepM }) };
}
