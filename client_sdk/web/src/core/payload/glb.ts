/** GLB payloads and the base mesh to what the GPU is given (scene format, section 9). */

import type { AttributeCodes, Bounds, CompressedImage, MeshData, MeshImage } from "../types.ts";
import { AccessorReader, BYTE, FLOAT, UNSIGNED_SHORT } from "./accessors.ts";
import { PayloadError } from "./errors.ts";
import { splitGlb } from "./glb-container.ts";
import type { TextureReference } from "./glb-texture.ts";
import { findTexture, IMAGE_EXTENSIONS, UV_TRANSFORM } from "./glb-texture.ts";
import type { ImageHeader } from "./image-header.ts";
import { readImageHeader } from "./image-header.ts";
import type { JsonObject } from "./json-values.ts";
import {
  expectList,
  expectNumber,
  expectObject,
  expectTriple,
  onlyOne,
  optionalObject,
  shortly,
} from "./json-values.ts";
import { boundsOf, checkIndices, checkNormals, largest } from "./mesh-checks.ts";

/** Decodes an image file; in a browser by `createImageBitmap`, KTX2 by a transcoder. */
export type DecodeImage = (bytes: Uint8Array<ArrayBuffer>, mediaType: string) => Promise<ImageBitmap | CompressedImage>;

const KNOWN: ReadonlySet<unknown> = new Set([
  "KHR_mesh_quantization",
  "EXT_meshopt_compression",
  "EXT_mesh_features",
  UV_TRANSFORM,
  ...IMAGE_EXTENSIONS.map(([, name]) => name),
]);
const NULL_CODE = 65535;
/** Largest attribute code that is a value. */
const LAST_CODE = 65534;
const FLOAT32_MAX = 3.4028234663852886e38;
/** Pixels of an image's longer side, in a segment and in the base. */
const MAX_SEGMENT_SIDE = 2048;
const MAX_BASE_SIDE = 4096;

/**
 * Decode one GLB payload; arrays stay quantised. Needs `prepareDecoders`. `bytes` are only read.
 *
 * The mesh has no image without `decodeImage`.
 *
 * @param segment Segment id; -1 for the base mesh.
 * @throws PayloadError For anything that is not a whole GLB of the profile.
 */
export async function decodeGlb(
  bytes: Uint8Array<ArrayBuffer>,
  segment: number,
  decodeImage?: DecodeImage,
): Promise<MeshData> {
  const { mesh, image } = readGlb(bytes, segment);
  if (image === null || decodeImage === undefined) return mesh;
  return { ...mesh, image: await openImage(image, decodeImage) };
}

/** An image file inside a payload, its header checked. */
interface ImageFile {
  readonly header: ImageHeader;
  readonly bytes: Uint8Array<ArrayBuffer>;
}

/**
 * Read and check everything but the pixels. Nothing of the file is trusted: each accessor is checked against the buffer and the
 * vertex count before an array is made of it, so that what is returned can be drawn without another look.
 */
function readGlb(bytes: Uint8Array<ArrayBuffer>, segment: number): { mesh: MeshData; image: ImageFile | null } {
  const glb = splitGlb(bytes);
  const { gltf } = glb;
  // (1) One mesh with one primitive of triangles, and no extension that would change its meaning.
  for (const name of expectList(gltf.extensionsRequired ?? [], "extensionsRequired")) {
    if (!KNOWN.has(name)) throw new PayloadError(`required extension ${shortly(name)}, expected one that we know`);
  }
  const mesh = onlyOne(gltf, "meshes");
  const primitive = onlyOne(mesh, "primitives");
  if ((primitive.mode ?? 4) !== 4) {
    throw new PayloadError(`primitive mode ${shortly(primitive.mode)}, expected 4 (triangles)`);
  }
  const names = expectObject(primitive.attributes, "attributes");
  // (2) Positions, and the node that brings codes to metres: together exact in float32.
  const reader = new AccessorReader(glb);
  const transform = nodeTransformOf(onlyOne(gltf, "nodes"));
  const positions = readPositions(reader, names.POSITION);
  if (
    positions instanceof Float32Array &&
    (transform.stepM !== 1 || transform.translation.some((side) => side !== 0))
  ) {
    throw new PayloadError("float positions with a node transform, expected none");
  }
  const vertexCount = positions instanceof Float32Array ? positions.length / 3 : positions.length / 4;

  /** Rows of 16-bit codes, one for each vertex. */
  const codes = (name: string, type: "SCALAR" | "VEC2" | "VEC4") => {
    const stride = type === "VEC4" ? 8 : 4;
    const expected = { label: name, components: [UNSIGNED_SHORT], type };
    const rows = reader.vertices(names[name], expected, () => stride);
    expectRows(name, rows.count, vertexCount);
    return { values: new Uint16Array(rows.bytes.buffer), normalised: rows.normalised };
  };

  // (3) Faces and attributes, as many rows as there are positions.
  const indices = reader.indices(primitive.indices);
  checkIndices(indices, vertexCount);
  const normalRows = reader.vertices(names.NORMAL, { label: "NORMAL", components: [BYTE], type: "VEC3" }, () => 4);
  expectRows("NORMAL", normalRows.count, vertexCount);
  const normals = new Int8Array(normalRows.bytes.buffer);
  checkNormals(normals);
  const texture = findTexture(gltf, primitive);
  if (texture !== null && names.COLOR_0 !== undefined) {
    throw new PayloadError("texture and COLOR_0 in one mesh, expected one of them (glTF multiplies)");
  }
  const colours = names.COLOR_0 === undefined ? null : codes("COLOR_0", "VEC4").values;
  const uvs = texture === null ? null : codes("TEXCOORD_0", "VEC2");
  const attributes = attributeTable(mesh).map(
    ({ gltfName, ...scale }): AttributeCodes => ({ ...scale, codes: codes(gltfName, "SCALAR").values }),
  );
  const image = texture === null ? null : readImage(reader, texture, segment);
  // (4) The box is of the decoded positions, not the accessor's min and max: culling must not believe the file.
  const result: MeshData = {
    segment,
    vertexCount,
    faceCount: indices.length / 3,
    ...transform,
    positions,
    normals,
    colours,
    uvs: uvs?.values ?? null,
    uvScale: uvs === null || texture === null ? [1, 1] : uvScaleOf(texture, uvs),
    regionIds: names._FEATURE_ID_0 === undefined ? null : codes("_FEATURE_ID_0", "SCALAR").values,
    attributes,
    indices,
    image: null,
    bounds: transformedBounds(boundsOf(positions), transform),
  };
  return { mesh: result, image };
}

function readPositions(reader: AccessorReader, number: unknown): Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer> {
  const expected = { label: "POSITION", components: [UNSIGNED_SHORT, FLOAT], type: "VEC3" } as const;
  const rows = reader.vertices(number, expected, (component) => (component === FLOAT ? 12 : 8));
  return rows.component === FLOAT ? new Float32Array(rows.bytes.buffer) : new Uint16Array(rows.bytes.buffer);
}

type Place = Pick<MeshData, "translation" | "stepM">;

function nodeTransformOf(node: JsonObject): Place {
  if (node.matrix !== undefined || node.rotation !== undefined) {
    throw new PayloadError("node has a matrix or rotation, expected translation and scale alone");
  }
  const translation = expectTriple(node.translation ?? [0, 0, 0], "translation");
  const scale = expectTriple(node.scale ?? [1, 1, 1], "scale");
  const [stepM] = scale;
  if (!(stepM > 0) || scale.some((side) => side !== stepM)) {
    throw new PayloadError(`node scale ${scale.join(", ")}, expected one positive number three times`);
  }
  return { translation, stepM };
}

/** The box in metres; codes are placed as the GPU places them. */
function transformedBounds(codes: Bounds, { translation, stepM }: Place): Bounds {
  const side = (axis: 0 | 1 | 2, code: number): number => {
    const value = Math.fround(translation[axis] + stepM * code);
    if (Number.isFinite(value)) return value;
    throw new PayloadError("a position beyond float32, expected finite numbers");
  };
  return [
    side(0, codes[0]),
    side(1, codes[1]),
    side(2, codes[2]),
    side(0, codes[3]),
    side(1, codes[4]),
    side(2, codes[5]),
  ];
}

function expectRows(label: string, count: number, vertexCount: number): void {
  if (count !== vertexCount)
    throw new PayloadError(`${label} has ${count} rows, expected ${vertexCount}: one a vertex`);
}

function attributeTable(mesh: JsonObject): { name: string; gltfName: string; offset: number; step: number }[] {
  const terraportExtras = optionalObject(optionalObject(mesh.extras, "extras").terraport, "extras.terraport");
  return expectList(terraportExtras.attributes ?? [], "extras.terraport.attributes").map((entry) => {
    const row = expectObject(entry, "attribute");
    const { name, gltf_name: gltfName } = row;
    if (typeof name !== "string" || typeof gltfName !== "string" || !gltfName.startsWith("_")) {
      throw new PayloadError(`attribute names ${shortly(name)}, ${shortly(gltfName)}, expected text and _TEXT`);
    }
    if ((row.null ?? NULL_CODE) !== NULL_CODE) {
      throw new PayloadError(`null code ${shortly(row.null)} of ${shortly(name)}, expected ${NULL_CODE}`);
    }
    const offset = expectNumber(row.offset, `offset of ${shortly(name)}`);
    const step = expectNumber(row.step, `step of ${shortly(name)}`);
    if (!(step > 0) || Math.abs(offset) > FLOAT32_MAX || Math.abs(offset + step * LAST_CODE) > FLOAT32_MAX) {
      throw new PayloadError(`scale of ${shortly(name)}: expected a step above 0 and all values within float32`);
    }
    return { name, gltfName, offset, step };
  });
}

function uvScaleOf(
  texture: TextureReference,
  uvs: { values: Uint16Array; normalised: boolean },
): readonly [number, number] {
  if ((texture.uvScale === null) !== uvs.normalised) {
    throw new PayloadError("TEXCOORD_0 must be normalised without a transform, and not with one");
  }
  // Codes over all 16 bits cannot leave the image.
  if (texture.uvScale === null) return [1 / 65535, 1 / 65535];
  const scale = texture.uvScale;
  if (largest(uvs.values, 0, 2) * scale[0] > 1 || largest(uvs.values, 1, 2) * scale[1] > 1) {
    throw new PayloadError("texture coordinates beyond the image, expected 0 to 1");
  }
  return scale;
}

function readImage(reader: AccessorReader, texture: TextureReference, segment: number): ImageFile {
  const bytes = reader.image(texture.view);
  const header = readImageHeader(bytes);
  const { mediaType, width, height } = header;
  if (mediaType !== texture.mediaType) {
    throw new PayloadError(`image is ${mediaType}, expected ${texture.mediaType} by mimeType`);
  }
  const maxSide = segment < 0 ? MAX_BASE_SIDE : MAX_SEGMENT_SIDE;
  for (const side of [width, height]) {
    if (side < 1 || side > maxSide || (side & (side - 1)) !== 0) {
      throw new PayloadError(`image of ${width} x ${height} pixels, expected powers of two, at most ${maxSide}`);
    }
  }
  return { header, bytes };
}

async function openImage({ header, bytes }: ImageFile, decodeImage: DecodeImage): Promise<MeshImage> {
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
