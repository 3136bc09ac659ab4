/**
 * The texture of a GLB: image and texture coordinates' scale, found along the chain from the material.
 *
 * glTF 2.0 (sections 3.8 and 3.9), `EXT_texture_webp`, `KHR_texture_basisu`, `KHR_texture_transform`.
 */

import { PayloadError } from "./errors.ts";
import type { JsonObject } from "./json-values.ts";
import { expectList, expectObject, optionalObject, pick, shortly } from "./json-values.ts";

/** Extension that brings codes of half texels to fractions of the image. */
export const UV_TRANSFORM = "KHR_texture_transform";

/** Extension that a texture needs for an image type outside core glTF. */
export const IMAGE_EXTENSIONS = [
  ["image/webp", "EXT_texture_webp"],
  ["image/ktx2", "KHR_texture_basisu"],
] as const;

/** Sides up to 32768 texels. */
const LEAST_SCALE = 2 ** -16;

/** What a material says of its texture. */
export interface TextureReference {
  /** bufferView of the image. */
  readonly view: unknown;
  readonly mediaType: string;
  /** What texture coordinates are multiplied with; null without a transform. */
  readonly uvScale: readonly [number, number] | null;
}

/**
 * Find the texture of a primitive's material; null where it has none.
 *
 * @throws PayloadError If the chain is broken, or outside the profile.
 */
export function findTexture(gltf: JsonObject, primitive: JsonObject): TextureReference | null {
  if (primitive.material === undefined) return null;
  const material = pick(expectList(gltf.materials, "materials"), primitive.material, "material");
  const surface = optionalObject(material.pbrMetallicRoughness, "pbrMetallicRoughness");
  if (surface.baseColorTexture === undefined) return null;
  const textureInfo = expectObject(surface.baseColorTexture, "baseColorTexture");
  if ((textureInfo.texCoord ?? 0) !== 0) throw new PayloadError("baseColorTexture has another set, expected set 0");
  return { ...findImage(gltf, textureInfo), uvScale: findScale(textureInfo) };
}

function findImage(gltf: JsonObject, textureInfo: JsonObject): Pick<TextureReference, "view" | "mediaType"> {
  const texture = pick(expectList(gltf.textures, "textures"), textureInfo.index, "texture");
  const extensions = optionalObject(texture.extensions, "extensions of texture");
  let source = texture.source;
  let allowed: readonly string[] = ["image/jpeg", "image/png"];
  for (const [mediaType, name] of IMAGE_EXTENSIONS) {
    if (extensions[name] === undefined) continue;
    source = expectObject(extensions[name], name).source;
    allowed = [mediaType];
  }
  const image = pick(expectList(gltf.images, "images"), source, "image");
  const mediaType = image.mimeType;
  if (typeof mediaType !== "string" || !allowed.includes(mediaType)) {
    throw new PayloadError(`image of type ${shortly(mediaType)}, expected ${allowed.join(" or ")}`);
  }
  return { view: image.bufferView, mediaType };
}

function findScale(textureInfo: JsonObject): readonly [number, number] | null {
  const extensions = optionalObject(textureInfo.extensions, "extensions of baseColorTexture");
  if (Object.keys(extensions).length === 0) return null;
  const transform = expectObject(extensions[UV_TRANSFORM], UV_TRANSFORM);
  const scale = expectList(transform.scale, `scale of ${UV_TRANSFORM}`);
  const [x, y] = scale;
  if (Object.keys(transform).length !== 1 || scale.length !== 2 || !isScale(x) || !isScale(y)) {
    throw new PayloadError(`${UV_TRANSFORM} is no scale of two powers of two up to 1 alone`);
  }
  return [x, y];
}

function isScale(value: unknown): value is number {
  return typeof value === "number" && value >= LEAST_SCALE && value <= 1 && Number.isInteger(Math.log2(value));
}
