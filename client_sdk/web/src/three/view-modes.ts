/** The ways to colour a scene's ground, and their names in text. PURE. */

import type { RegionFacts, SceneManifest } from "../core/types.ts";
import { MODE_NUMBER } from "./ground-shader.ts";
import type { ViewMode } from "./types.ts";

/** A way to colour the ground. */
export interface ViewModeChoice {
  readonly mode: ViewMode;
  /** For people. */
  readonly name: string;
  readonly hint: string;
}

/** The modes that a scene has; by name only where some region has one. */
export function modesOf(manifest: SceneManifest, regions: readonly RegionFacts[] = []): readonly ViewModeChoice[] {
  const isPhotographed = manifest.texturesOf === "photos";
  const isGrey = manifest.texturesOf === null && !manifest.hasColour;
  const choices: ViewModeChoice[] = [
    {
      mode: { kind: "colour" },
      name: isPhotographed ? "Photographs" : "Colour",
      hint: isGrey ? "none here: grey" : "as surveyed",
    },
  ];
  if (isPhotographed && manifest.hasColour) {
    choices.push({ mode: { kind: "vertex-colour" }, name: "Point colours", hint: "without photographs" });
  }
  choices.push({ mode: { kind: "regions" }, name: "Regions", hint: "what the ground is" });
  if (regions.some(({ label }) => label !== null)) {
    choices.push({ mode: { kind: "names" }, name: "Names", hint: "what people call it" });
  }
  for (const { name, min, max } of manifest.attributes) {
    choices.push({ mode: attributeMode(name, min, max), name, hint: "measured" });
  }
  choices.push({ mode: { kind: "slope" }, name: "Slope", hint: "level to vertical" });
  choices.push({ mode: { kind: "segments" }, name: "Segments", hint: "how it is streamed" });
  return choices;
}

/** An attribute over all its values; where there are none, over something that has a length. */
export function attributeMode(name: string, min: number | null, max: number | null): ViewMode {
  const low = min ?? 0;
  const high = max ?? 1;
  return { kind: "attribute", name, min: low, max: high > low ? high : low + 1 };
}

/** A mode as text: its kind, or `attribute:NAME`. */
export function keyOfMode(mode: ViewMode): string {
  return mode.kind === "attribute" ? `attribute:${mode.name}` : mode.kind;
}

/** The scene's mode of that text; null where it has none such. */
export function modeOfKey(key: string, manifest: SceneManifest, regions: readonly RegionFacts[] = []): ViewMode | null {
  return modesOf(manifest, regions).find(({ mode }) => keyOfMode(mode) === key)?.mode ?? null;
}

/**
 * A mode, given as one or as its text.
 *
 * @throws RangeError on what is no mode of this scene: another text or kind, an attribute that the scene does not have, a
 * range without numbers.
 */
export function modeFrom(
  given: ViewMode | string,
  manifest: SceneManifest,
  regions: readonly RegionFacts[] = [],
): ViewMode {
  const mode = typeof given === "string" ? modeOfKey(given, manifest, regions) : given;
  const isAttribute = mode?.kind === "attribute" && manifest.attributes.some(({ name }) => name === mode.name);
  if (isAttribute && Number.isFinite(mode.min) && Number.isFinite(mode.max)) return mode;
  // Kinds without parameters are valid in every scene: ground without data is drawn paled.
  if (mode && mode.kind !== "attribute" && Object.hasOwn(MODE_NUMBER, mode.kind)) return mode;
  const keys = modesOf(manifest, regions).map((choice) => keyOfMode(choice.mode));
  throw new RangeError(`got mode ${JSON.stringify(given)}, expected one of ${keys.join(", ")}`);
}
