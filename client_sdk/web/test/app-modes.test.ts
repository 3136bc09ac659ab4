/** What the panel calls the ways to see the ground: true of the scene at hand. */

import { describe, expect, it } from "vitest";
import type { SceneManifest } from "../src/core/types.ts";
import { modesOf } from "../src/three/view-modes.ts";

function manifest(texturesOf: SceneManifest["texturesOf"], hasColour: boolean): SceneManifest {
  return {
    id: "pit",
    name: "Pit",
    version: "0".repeat(32),
    crs: null,
    origin: [0, 0, 0],
    surveyUnits: null,
    stepM: 0.001,
    bounds: [0, 0, 0, 1, 1, 1],
    attributes: [],
    segmentCount: 1,
    levels: 1,
    detailFaces: 1,
    hasColour,
    texturesOf,
    deviationM: 0,
  };
}

describe("the modes of a scene", () => {
  it.each([
    ["photos", false, ["Photographs", "as surveyed"]],
    ["points", false, ["Colour", "as surveyed"]],
    [null, true, ["Colour", "as surveyed"]],
    [null, false, ["Colour", "none here: grey"]],
  ] as const)("textures of %s, vertex colours %s", (texturesOf, hasColour, [name, hint]) => {
    expect(modesOf(manifest(texturesOf, hasColour))[0]).toMatchObject({ name, hint });
  });
});
