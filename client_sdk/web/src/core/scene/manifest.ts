/** scene.json as a server gives it, checked for what the viewer uses (scene format, section 4). */

import { PayloadError } from "../payload/errors.ts";
import type { AttributeInfo, Bounds, SceneManifest } from "../types.ts";
import { StreamError } from "./errors.ts";
import type { JsonObject } from "./json-values.ts";
import { expectList, expectNumber, expectObject, expectTriple, expectWhole, shortly } from "./json-values.ts";
import { isSurveyAxis } from "./survey.ts";

/** A file of a version. */
export interface FileFacts {
  readonly bytes: number;
}

/** Files that are loaded once for a version. */
export type LoadedFile = "base.tsg" | "regions.json";

/** The base in brief, which a version may have. */
export const OVERVIEW = "overview.tsg";

/** A manifest, and what must come with it. */
export interface CheckedManifest {
  readonly manifest: SceneManifest;
  readonly baseFaces: number;
  /** Folder of the version, before the names of its files. */
  readonly folder: string;
  readonly files: Readonly<Record<LoadedFile, FileFacts>>;
  /** Absent where the base is the first picture. */
  readonly overview?: FileFacts;
}

/** Section 12. */
const MAX_FILE_BYTES: Readonly<Record<LoadedFile | typeof OVERVIEW, number>> = {
  "base.tsg": 2 ** 30,
  [OVERVIEW]: 2 ** 30,
  "regions.json": 2 ** 28,
};
const MAJOR = "1";
/** Of the payloads that this client reads. */
const ENCODING = "segment-2";
const FLOAT32_MAX = 3.4028234663852886e38;
/** Largest attribute code that is a value. */
const LAST_CODE = 65534;
const DIGEST = /^[0-9a-f]{32}$/;
/** Image types that a browser opens by itself. */
const OPENABLE: ReadonlySet<unknown> = new Set(["image/jpeg", "image/png", "image/webp"]);

/**
 * Check a manifest; keys that are not known are skipped.
 *
 * @param id Scene id of the URL.
 * @throws StreamError `unsupported_version` for another format or major version; `damaged` where a needed key is missing
 * or not what it should be.
 */
export function checkManifest(json: JsonObject, id: string): CheckedManifest {
  checkFormat(json);
  try {
    return readManifest(json, id);
  } catch (error) {
    if (!(error instanceof PayloadError)) throw error;
    throw new StreamError("damaged", `manifest of scene ${id}: ${error.message}; the scene must be published anew`);
  }
}

function checkFormat(json: JsonObject): void {
  const { format, format_version: version } = json;
  if (format !== "terraport-scene") {
    const text = `got format ${shortly(format)}, expected "terraport-scene"; is this a terraport server?`;
    throw new StreamError("damaged", text);
  }
  if (typeof version !== "string" || version.split(".")[0] !== MAJOR) {
    const text = `got scene format ${shortly(version)}, expected ${MAJOR}.x; a newer viewer is needed`;
    throw new StreamError("unsupported_version", text);
  }
}

function readManifest(json: JsonObject, id: string): CheckedManifest {
  const counts = expectObject(json.counts, "counts");
  const files = expectObject(json.files, "files");
  const encodings = expectObject(json.encodings, "encodings");
  expectObject(encodings[ENCODING], `encodings.${ENCODING}`);
  const manifest: SceneManifest = {
    id,
    name: expectText(json.name, "name"),
    version: expectDigest(json.version, DIGEST, "version"),
    crs: readCrs(json.crs),
    origin: expectTriple(json.origin, "origin"),
    surveyUnits: readSurveyUnits(json.survey_units ?? null),
    stepM: expectStep(json.step_m),
    bounds: readBounds(json.bounds),
    attributes: expectList(json.attributes, "attributes").map(readAttribute),
    segmentCount: expectWhole(counts.segments, "counts.segments", 1),
    levels: expectWhole(json.levels ?? 1, "levels", 1),
    detailFaces: expectWhole(counts.detail_faces, "counts.detail_faces", 1),
    hasColour: expectFlag(json.has_colour, "has_colour"),
    texturesOf: texturesOf(json.textures),
    deviationM: expectLength(expectObject(json.hand_off, "hand_off").deviation_m, "hand_off.deviation_m"),
  };
  const links = (json.links ?? {}) as JsonObject;
  return {
    manifest: typeof links.strokes === "string" ? { ...manifest, mayPaint: true } : manifest,
    baseFaces: expectWhole(counts.base_faces, "counts.base_faces", 1),
    folder: expectText(expectObject(files["base.tsg"], "base.tsg").path, "path of base.tsg").split("/")[0]!,
    ...(files[OVERVIEW] !== undefined && { overview: readFile(files, OVERVIEW) }),
    files: {
      "base.tsg": readFile(files, "base.tsg"),
      "regions.json": readFile(files, "regions.json"),
    },
  };
}

function readCrs(value: unknown): SceneManifest["crs"] {
  if (value === null) return null;
  const crs = expectObject(value, "crs");
  const epsg = crs.epsg ?? null;
  return { name: expectText(crs.name, "crs.name"), epsg: epsg === null ? null : expectWhole(epsg, "crs.epsg", 0) };
}

function readSurveyUnits(value: unknown): SceneManifest["surveyUnits"] {
  if (value === null) return null;
  const units = expectObject(value, "survey_units");
  const [horizontalM, heightM] = [
    expectLength(units.horizontal_m, "survey_units.horizontal_m"),
    expectLength(units.height_m, "survey_units.height_m"),
  ];
  if (horizontalM === 0 || heightM === 0) throw new PayloadError("survey_units has a unit of 0 m");
  if (units.axes === undefined) return { horizontalM, heightM };
  const axes = expectList(units.axes, "survey_units.axes");
  const [x, y, z] = axes;
  if (axes.length !== 3 || !isSurveyAxis(x) || !isSurveyAxis(y) || !isSurveyAxis(z))
    throw new PayloadError(`survey_units.axes are ${JSON.stringify(axes)}, expected such as east, north, up`);
  return { horizontalM, heightM, axes: [x, y, z] };
}

function readBounds(value: unknown): Bounds {
  const box = expectObject(value, "bounds");
  const [minX, minY, minZ] = expectTriple(box.min, "bounds.min");
  const [maxX, maxY, maxZ] = expectTriple(box.max, "bounds.max");
  if (minX > maxX || minY > maxY || minZ > maxZ) throw new PayloadError("bounds.min is above bounds.max");
  return [minX, minY, minZ, maxX, maxY, maxZ];
}

function readAttribute(value: unknown): AttributeInfo {
  const attribute = expectObject(value, "attribute");
  const name = expectText(attribute.name, "name of an attribute");
  const extreme = (key: "min" | "max") =>
    attribute[key] === null ? null : expectNumber(attribute[key], `${key} of attribute ${shortly(name)}`);
  const offset = expectNumber(attribute.offset, `offset of attribute ${shortly(name)}`);
  const step = expectNumber(attribute.step, `step of attribute ${shortly(name)}`);
  if (!(step > 0) || Math.abs(offset) > FLOAT32_MAX || Math.abs(offset + step * LAST_CODE) > FLOAT32_MAX) {
    throw new PayloadError(`scale of attribute ${shortly(name)}: expected a step above 0 and values within float32`);
  }
  return { name, offset, step, min: extreme("min"), max: extreme("max") };
}

function readFile(files: JsonObject, key: keyof typeof MAX_FILE_BYTES): FileFacts {
  const file = expectObject(files[key], key);
  const bytes = expectWhole(file.bytes, `bytes of ${key}`, 1);
  if (bytes > MAX_FILE_BYTES[key])
    throw new PayloadError(`${key} of ${bytes} bytes, expected at most ${MAX_FILE_BYTES[key]}`);
  return { bytes };
}

/** What textures show of which some can be opened here. */
function texturesOf(value: unknown): SceneManifest["texturesOf"] {
  if (value === undefined || value === null) return null;
  const textures = expectObject(value, "textures");
  if (!expectList(textures.media_types, "textures.media_types").some((mediaType) => OPENABLE.has(mediaType)))
    return null;
  return textures.source === "vertex" ? "points" : "photos";
}

function expectText(value: unknown, label: string): string {
  if (typeof value === "string" && value !== "") return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected text`);
}

function expectDigest(value: unknown, pattern: RegExp, label: string): string {
  if (typeof value === "string" && pattern.test(value)) return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected hexadecimal digits`);
}

function expectFlag(value: unknown, label: string): boolean {
  if (typeof value === "boolean") return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected true or false`);
}

function expectLength(value: unknown, label: string): number {
  const length = expectNumber(value, label);
  if (length >= 0) return length;
  throw new PayloadError(`${label} is ${length}, expected a length`);
}

function expectStep(value: unknown): number {
  const step = expectNumber(value, "step_m");
  if (step > 0 && Number.isInteger(Math.log2(step))) return step;
  throw new PayloadError(`step_m is ${step}, expected a power of two`);
}
