/** Strokes that people paint on a scene, and what they have taught (protocol, section 11). A shell: it fetches. */

import { PayloadError } from "../payload/errors.ts";
import { StreamError } from "../scene/errors.ts";
import { fetchBytes, fetchJson, type HttpOptions, parseJson } from "../scene/http.ts";
import type { JsonObject } from "../scene/json-values.ts";
import { expectList, expectNumber, expectObject, expectWhole, shortly } from "../scene/json-values.ts";
import type { PaintedStroke, Stroke, TaughtGround, TaughtName } from "./stroke-types.ts";

/** All strokes of a scene, in the order in which they were painted. */
export interface StrokeList {
  readonly strokes: readonly PaintedStroke[];
  /** What {@link TaughtGround.revision} says of these strokes. */
  readonly revision: string;
}

const MAX_TAUGHT_BYTES = 8 * 2 ** 20;
const MAX_SQUARES = 1_048_576;
const MAX_NAMES = 64;
const COLOUR = /^#[0-9a-f]{6}$/;

/** What was painted on a scene; the token must let its bearer teach. */
export async function listStrokes(sceneUrl: string, options: HttpOptions): Promise<StrokeList> {
  const url = `${sceneUrl}/strokes`;
  const json = await fetchJson(url, options);
  return checked(url, () => ({
    strokes: expectList(json.strokes, "strokes").map(readStroke),
    revision: expectText(json.revision, "revision"),
  }));
}

/** Paint a stroke; the revision with it. */
export async function paintStroke(
  sceneUrl: string,
  { name, colour, widthM, line }: Stroke,
  options: HttpOptions,
): Promise<{ readonly stroke: PaintedStroke; readonly revision: string }> {
  const url = `${sceneUrl}/strokes`;
  const body = { name, colour, width_m: widthM, line };
  const json = await fetchJson(url, { ...options, method: "POST", body });
  return checked(url, () => ({
    stroke: readStroke(json.stroke),
    revision: expectText(json.revision, "revision"),
  }));
}

/** Take back a stroke of one's own; the revision without it. */
export async function takeBackStroke(sceneUrl: string, id: string, options: HttpOptions): Promise<string> {
  const url = `${sceneUrl}/strokes/${encodeURIComponent(id)}`;
  const json = await fetchJson(url, { ...options, method: "DELETE" });
  return checked(url, () => expectText(json.revision, "revision"));
}

/** What the strokes have taught so far; null where nothing was. */
export async function fetchTaught(sceneUrl: string, options: HttpOptions): Promise<TaughtGround | null> {
  const url = `${sceneUrl}/taught`;
  const bytes = await fetchBytes(url, options, { maxBytes: MAX_TAUGHT_BYTES, isExact: false });
  if (bytes.length === 0) return null;
  const json = checked(url, () => expectObject(parseJson(bytes, url), "taught.json"));
  if (json.format !== "terraport-taught" || !String(json.format_version).startsWith("1.")) {
    throw new StreamError("damaged", `${url} is ${shortly(json.format)}, expected terraport-taught 1.x`, 200);
  }
  const head = checked(url, () => ({
    revision: expectText(json.strokes, "strokes"),
    state: expectText(json.state, "state"),
    text: expectText(json.text, "text"),
  }));
  if (head.state === "refused") return { ...head, picture: null };
  const frame = checked(url, () => readFrame(json));
  const [kind, doubt] = await Promise.all(
    (["kind", "doubt"] as const).map((key) => unpacked(url, json[key], key, frame.rows * frame.columns)),
  );
  return { ...head, picture: { ...frame, kind: kind!, doubt: doubt! } };
}

function readFrame(json: JsonObject) {
  const names = expectList(json.names, "names").map(readName);
  const rows = expectWhole(json.rows, "rows", 1);
  const columns = expectWhole(json.columns, "columns", 1);
  if (names.length > MAX_NAMES || rows * columns > MAX_SQUARES) {
    throw new PayloadError(`${names.length} names on ${rows * columns} squares, expected at most 64 on ${MAX_SQUARES}`);
  }
  const cellM = expectNumber(json.cell_m, "cell_m");
  if (!(cellM > 0)) throw new PayloadError(`cell_m is ${cellM}, expected a length`);
  return {
    names,
    rows,
    columns,
    cellM,
    cornerM: readPlace(json.corner_m, "corner_m"),
    places: expectList(json.places, "places").map((value) => {
      const place = expectObject(value, "a place");
      return {
        position: readPlace(place.position, "position"),
        doubt: expectNumber(place.doubt, "doubt"),
        likeliest: expectText(place.likeliest, "likeliest"),
        other: expectText(place.or, "or"),
      };
    }),
  };
}

function readName(value: unknown): TaughtName {
  const name = expectObject(value, "a name");
  return {
    name: expectText(name.name, "name"),
    colour: expectColour(name.colour),
    areaM2: expectNumber(name.area_m2, "area_m2"),
    confidence: expectNumber(name.confidence, "confidence"),
  };
}

function readStroke(value: unknown): PaintedStroke {
  const stroke = expectObject(value, "a stroke");
  return {
    id: expectText(stroke.id, "id"),
    name: expectText(stroke.name, "name"),
    colour: expectColour(stroke.colour),
    widthM: expectNumber(stroke.width_m, "width_m"),
    line: expectList(stroke.line, "line").map((place) => readPlace(place, "a place of the line")),
    who: expectText(stroke.who, "who"),
    when: expectText(stroke.when, "when"),
    isOwn: stroke.yours === true,
  };
}

function readPlace(value: unknown, label: string): readonly [number, number] {
  const numbers = expectList(value, label);
  if (numbers.length !== 2) throw new PayloadError(`${label} has ${numbers.length} numbers, expected 2`);
  return [expectNumber(numbers[0], label), expectNumber(numbers[1], label)];
}

function expectText(value: unknown, label: string): string {
  if (typeof value === "string") return value;
  throw new PayloadError(`${label} is ${shortly(value)}, expected text`);
}

function expectColour(value: unknown): string {
  const text = expectText(value, "colour");
  if (COLOUR.test(text)) return text;
  throw new PayloadError(`colour is ${shortly(value)}, expected # and six hexadecimal digits`);
}

/** A picture of bytes out of base64 and zlib; never more than it must be is kept. */
async function unpacked(url: string, value: unknown, key: string, size: number): Promise<Uint8Array<ArrayBuffer>> {
  try {
    const packed = Uint8Array.from(atob(expectText(value, key)), (letter) => letter.charCodeAt(0));
    const reader = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
    const bytes = new Uint8Array(size);
    let filled = 0;
    for (;;) {
      const { done, value: chunk } = await reader.read();
      if (done) break;
      if (chunk.length > size - filled) throw new PayloadError(`${key} is longer than ${size} squares`);
      bytes.set(chunk, filled);
      filled += chunk.length;
    }
    if (filled !== size) throw new PayloadError(`${key} has ${filled} squares, expected ${size}`);
    return bytes;
  } catch (error) {
    const reason = error instanceof Error ? error.message : String(error);
    throw new StreamError("damaged", `${url}: ${key} does not unpack (${reason})`, 200, { cause: error });
  }
}

function checked<T>(url: string, read: () => T): T {
  try {
    return read();
  } catch (error) {
    if (!(error instanceof PayloadError)) throw error;
    throw new StreamError("damaged", `${url}: ${error.message}`, 200, { cause: error });
  }
}
