/** The base mesh, a GLB, to what the GPU is given (scene format, section 9). */

import type { AttributeCodes, MeshData } from "../types.ts";
import { AccessorReader, BYTE, FLOAT, UNSIGNED_SHORT } from "./accessors.ts";
import { PayloadError } from "./errors.ts";
import { splitGlb } from "./glb-container.ts";
import type { TextureReference } from "./glb-texture.ts";
import { findTexture, IMAGE_EXTENSIONS, UV_TRANSFORM } from "./glb-texture.ts";
import type { DecodeImage, ImageFile } from "./image-file.ts";
import { checkedImage, openImage } from "./image-file.ts";
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
import { boundsOf, checkIndices, checkNormals, largest, transformedBounds } from "./mesh-checks.ts";
import { prepareMeshopt } from "./meshopt.ts";

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
/** Pixels of the image's longer side. */
const MAX_SIDE = 4096;
/**
 * Decode a base mesh; arrays stay quantised. `bytes` are only read.
 *
 * The mesh has no image without `decodeImage`.
 *
 * @throws PayloadError For anything that is not a whole GLB of the profile.
 */
export async function decodeGlb(bytes: Uint8Array<ArrayBuffer>, decodeImage?: DecodeImage): Promise<MeshData> {
  await prepareMeshopt();
  const { mesh, image } = readGlb(bytes);
  if (image === null || decodeImage === undefined) return mesh;
  return { ...mesh, image: await openImage(image, decodeImage) };
}

/**
 * Read and check everything but the pixels. Nothing of the file is trusted: each accessor is checked against the buffer and the
 * vertex count before an array is made of it, so that what is returned can be drawn without another look.
 */
function readGlb(bytes: Uint8Array<ArrayBuffer>): { mesh: MeshData; image: ImageFile | null } {
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
  const image = texture === null ? null : checkedImage(reader.image(texture.view), texture.mediaType, MAX_SIDE);
  // (4) The box is of the decoded positions, not the accessor's min and max: culling must not believe the file.
  const result: MeshData = {
    segment: -1,
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
