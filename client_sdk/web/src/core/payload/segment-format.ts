/** Segments in segment format 2 (spec/segment-format.md) to what the GPU is given. */

import type { AttributeScale, Bounds, MeshData, Vec3 } from "../types.ts";
import { crc32 } from "./crc32.ts";
import { PayloadError } from "./errors.ts";
import { inflate } from "./gzip.ts";
import { checkedImage, type DecodeImage, type ImageFile, MAX_IMAGE_BYTES, openImage } from "./image-file.ts";
import { countBits, countOnes, isSet, Planes } from "./planes.ts";
import { linearColours, unfoldedNormals } from "./vertex-codes.ts";

/** "TSG2", little-endian. */
const MAGIC = 0x32475354;
const OUTER_BYTES = 12;
const HEAD_BYTES = 40;
const MAX_STREAM_BYTES = 2 ** 28;
const [COLOURS, UVS, REGIONS, WIDE] = [1, 2, 4, 8];
const ALL_FLAGS = 15;
const MEDIA_TYPES = ["", "image/jpeg", "image/png", "image/webp", "image/ktx2"];
/** Pixels of the image's longer side; base and overview may have larger images, and wide positions. */
const MAX_SIDE = { segment: 2048, base: 4096 };
const NO_REGION = 0xffff;
/** Float32 holds every whole number of steps below it. */
const MAX_STEPS = 2 ** 24;
/** Metres: 2^24 of them are finite in float32. */
const MAX_STEP_M = 2 ** 103;

/**
 * Decode one segment. The mesh has no image without `decodeImage`. `bytes` are only read.
 *
 * @param attributes - of the manifest of the segment's version.
 * @param kind - `base` for base and overview.
 * @throws PayloadError for anything that is not a whole segment.
 */
export async function decodeSegment(
  bytes: Uint8Array<ArrayBuffer>,
  attributes: readonly AttributeScale[],
  decodeImage?: DecodeImage,
  kind: keyof typeof MAX_SIDE = "segment",
): Promise<MeshData> {
  const segment = await openSegment(bytes);
  const { mesh, image } = readMesh(segment, attributes, MAX_SIDE[kind]);
  return image === null || decodeImage === undefined ? mesh : { ...mesh, image: await openImage(image, decodeImage) };
}

/**
 * Check a segment's checksum and planes; returns the box of its positions, metres.
 *
 * @throws PayloadError for anything that is not a whole segment.
 */
export async function segmentBounds(bytes: Uint8Array<ArrayBuffer>): Promise<Bounds> {
  const { head, planes, faces } = await openSegment(bytes);
  planes.skip(faces.oldWidth * faces.oldCount);
  return readPositions(planes, head).bounds;
}

/** A segment whose stream is inflated, and has the length that its head says. `planes` begin behind the planes of bits. */
interface OpenSegment {
  readonly head: Head;
  readonly planes: Planes;
  readonly faces: {
    readonly starts: Uint8Array;
    readonly lefts: Uint8Array;
    readonly news: Uint8Array;
    readonly oldCount: number;
    readonly oldWidth: 2 | 4;
  };
  readonly image: Uint8Array<ArrayBuffer>;
}

interface Head {
  readonly vertexCount: number;
  readonly faceCount: number;
  readonly origin: Vec3;
  readonly stepM: number;
  readonly flags: number;
  readonly imageKind: number;
  readonly region: number;
  readonly width: number;
  readonly height: number;
  readonly attributeMask: number;
  readonly imageCrc: number;
}

async function openSegment(bytes: Uint8Array<ArrayBuffer>): Promise<OpenSegment> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  if (bytes.length < OUTER_BYTES || view.getUint32(0, true) !== MAGIC) {
    throw new PayloadError(`got ${bytes.length} bytes without magic TSG2, expected a segment`);
  }
  const end = OUTER_BYTES + view.getUint32(4, true);
  const imageBytes = view.getUint32(8, true);
  if (end + imageBytes !== bytes.length || imageBytes > MAX_IMAGE_BYTES) {
    throw new PayloadError(`got ${bytes.length} bytes, expected ${end} and an image of ${imageBytes}`);
  }
  const stream = await inflate(bytes.subarray(OUTER_BYTES, end), MAX_STREAM_BYTES);
  const head = readHead(stream);
  const { vertexCount, faceCount, flags, attributeMask } = head;
  const planes = new Planes(stream, HEAD_BYTES);
  const [starts, lefts] = [planes.bits(faceCount), planes.bits(faceCount)];
  const nameCount = faceCount + 2 * countBits(starts, faceCount);
  const news = planes.bits(nameCount);
  const oldCount = nameCount - vertexCount;
  const oldWidth = vertexCount <= 65536 ? 2 : 4;
  // The lengths must be the stream's before anything is reserved for them.
  let vertexBytes = flags & WIDE ? 14 : 8;
  vertexBytes += (flags & COLOURS && 3) + (flags & UVS && 4) + (flags & REGIONS && 2) + 2 * countOnes(attributeMask);
  if (oldCount < 0 || planes.left !== oldWidth * oldCount + vertexBytes * vertexCount) {
    throw new PayloadError(
      `got ${planes.left} bytes of planes, expected those of ${oldCount} corners and ${vertexCount} vertices`,
    );
  }
  return { head, planes, faces: { starts, lefts, news, oldCount, oldWidth }, image: bytes.subarray(end) };
}

function readHead(stream: Uint8Array<ArrayBuffer>): Head {
  if (stream.length < HEAD_BYTES) throw new PayloadError(`got a stream of ${stream.length} bytes, expected a head`);
  const view = new DataView(stream.buffer);
  const head: Head = {
    vertexCount: view.getUint32(0, true),
    faceCount: view.getUint32(4, true),
    origin: [view.getInt32(8, true), view.getInt32(12, true), view.getInt32(16, true)],
    stepM: 2 ** view.getInt8(20),
    flags: view.getUint8(21),
    imageKind: view.getUint8(22),
    region: view.getUint16(24, true),
    width: view.getUint16(26, true),
    height: view.getUint16(28, true),
    attributeMask: view.getUint32(32, true),
    imageCrc: view.getUint32(36, true),
  };
  const { vertexCount, faceCount, flags, imageKind } = head;
  const hasBoth = (flags & COLOURS) !== 0 && (flags & UVS) !== 0;
  if (vertexCount < 1 || faceCount < 1 || flags > ALL_FLAGS || hasBoth || imageKind >= MEDIA_TYPES.length) {
    const got = `got ${vertexCount} vertices, ${faceCount} faces, flags ${flags}, image ${imageKind}`;
    throw new PayloadError(`${got}, expected a head of segment format 2`);
  }
  return head;
}

function readMesh(
  { head, planes, faces, image }: OpenSegment,
  attributes: readonly AttributeScale[],
  maxSide: number,
): { mesh: MeshData; image: ImageFile | null } {
  const { vertexCount, faceCount, flags, region, width, height } = head;
  if (head.attributeMask >= 2 ** attributes.length) {
    const got = `got attributes ${head.attributeMask.toString(2)}`;
    throw new PayloadError(`${got}, expected of the scene's ${attributes.length}`);
  }
  const present = attributes.filter((_, bit) => Math.floor(head.attributeMask / 2 ** bit) % 2 === 1);
  // (1) Faces.
  const { oldCount, oldWidth } = faces;
  const old = planes.differences(new (oldWidth === 2 ? Uint16Array : Uint32Array)(oldCount), oldWidth);
  const indices = new (vertexCount < 65536 ? Uint16Array : Uint32Array)(3 * faceCount);
  const newCount = readFaces(faces.starts, faces.lefts, faces.news, old, indices);
  if (newCount !== vertexCount) {
    throw new PayloadError(`got ${newCount} vertices in faces, expected ${vertexCount}`);
  }
  // (2) Vertices.
  const plane = () => planes.differences(new Uint8Array(vertexCount), 1);
  const codes = () => planes.differences(new Uint16Array(2 * vertexCount), 2, 0, 2);
  const place = readPositions(planes, head);
  const normals = unfoldedNormals(plane(), plane());
  const colours = flags & COLOURS ? linearColours(plane(), plane(), plane()) : null;
  const uvs = flags & UVS ? codes() : null;
  if (uvs !== null) planes.differences(uvs, 2, 1, 2);
  const oneRegion = region === NO_REGION ? null : new Uint16Array(2 * vertexCount).fill(region);
  const mesh: MeshData = {
    vertexCount,
    faceCount,
    ...place,
    normals,
    colours,
    uvs,
    uvScale: uvs === null ? [1, 1] : [0.5 / width, 0.5 / height],
    regionIds: flags & REGIONS ? codes() : oneRegion,
    attributes: present.map(({ name, offset, step }) => ({ name, offset, step, codes: codes() })),
    indices,
    image: null,
  };
  // (3) The image.
  const hasImage = image.length > 0;
  if (hasImage !== head.imageKind > 0 || hasImage !== (uvs !== null) || crc32(image) !== head.imageCrc) {
    throw new PayloadError("image is damaged or missing, or has no texture coordinates");
  }
  if (uvs === null) return { mesh, image: null };
  const file = checkedImage(image, MEDIA_TYPES[head.imageKind], maxSide);
  if (file.header.width !== width || file.header.height !== height) {
    throw new PayloadError(`image of ${width} x ${height} pixels by the head, its own header says otherwise`);
  }
  if (largest(uvs, 0, 2) > 2 * width || largest(uvs, 1, 2) > 2 * height) {
    throw new PayloadError("texture coordinates beyond the image, expected 0 to 1");
  }
  return { mesh, image: file };
}

/** Read the positions, and their box in metres. Wide ones become metres of the scene frame. */
function readPositions(
  planes: Planes,
  { vertexCount, origin, stepM, flags }: Head,
): Pick<MeshData, "positions" | "translation" | "stepM" | "bounds"> {
  if (stepM > MAX_STEP_M) throw new PayloadError(`steps of ${stepM} m, expected at most 2^103`);
  const isWide = (flags & WIDE) !== 0;
  const codes = isWide ? new Uint32Array(4 * vertexCount) : new Uint16Array(4 * vertexCount);
  for (const axis of [0, 1, 2]) planes.differences(codes, isWide ? 4 : 2, axis, 4);
  const box = boundsOf(codes);
  if (origin.some((steps, axis) => Math.max(-steps, steps + box[axis + 3]!) >= MAX_STEPS)) {
    throw new PayloadError("a position 2^24 steps or more from the scene's origin, expected less");
  }
  const bounds = box.map((code, at) => (origin[at % 3]! + code) * stepM) as unknown as Bounds;
  if (codes instanceof Uint16Array) {
    const translation = [origin[0] * stepM, origin[1] * stepM, origin[2] * stepM] as const;
    return { positions: codes, translation, stepM, bounds };
  }
  const positions = new Float32Array(3 * vertexCount);
  for (let vertex = 0; vertex < vertexCount; vertex += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      positions[3 * vertex + axis] = (origin[axis]! + codes[4 * vertex + axis]!) * stepM;
    }
  }
  return { positions, translation: [0, 0, 0], stepM: 1, bounds };
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

/** Box of positions of four entries a vertex. */
function boundsOf(positions: Uint16Array | Uint32Array): Bounds {
  const box = [Number.POSITIVE_INFINITY, Number.POSITIVE_INFINITY, Number.POSITIVE_INFINITY, 0, 0, 0];
  for (let at = 0; at < positions.length; at += 4) {
    for (let axis = 0; axis < 3; axis += 1) {
      const code = positions[at + axis]!;
      if (code < box[axis]!) box[axis] = code;
      if (code > box[axis + 3]!) box[axis + 3] = code;
    }
  }
  return box as unknown as Bounds;
}

/** The largest of every `width`-th entry, from `first` on. */
function largest(values: Uint16Array, first: number, width: number): number {
  let maximum = 0;
  for (let at = first; at < values.length; at += width) maximum = Math.max(maximum, values[at]!);
  return maximum;
}
