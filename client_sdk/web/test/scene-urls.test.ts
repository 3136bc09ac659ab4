/** Scene URLs in every form, the cases of tests/sdk/test_urls.py; survey coordinates. */

import { describe, expect, it } from "vitest";
import { StreamError } from "../src/core/scene/errors.ts";
import { toSurvey } from "../src/core/scene/survey.ts";
import { parseSceneUrl, sceneUrlOf, streamUrl } from "../src/core/scene/urls.ts";

it.each([
  ["http://h:8080/scenes/pit", "http://h:8080", "pit"],
  ["ws://h:8080/scenes/pit/stream", "http://h:8080", "pit"],
  ["wss://h/tp/scenes/pit/", "https://h/tp", "pit"],
  ["https://h/", "https://h", null],
  ["http://h/prefix", "http://h/prefix", null],
  ["http://h/prefix/scenes", "http://h/prefix", null],
  ["http://h/prefix/scenes/", "http://h/prefix", null],
  ["http://[::1]:81/scenes/a%2Fb", "http://[::1]:81", "a/b"],
])("%s is read", (url, server, scene) => {
  expect(parseSceneUrl(url)).toEqual({ server, scene });
});

it("quotes what it builds", () => {
  expect(sceneUrlOf("https://h/tp/", "a b/c")).toBe("https://h/tp/scenes/a%20b%2Fc");
  expect(sceneUrlOf("wss://h/scenes/other/stream", "n(1)")).toBe("https://h/scenes/n%281%29");
  expect(streamUrl("https://h/tp/scenes/a%20b%2Fc")).toBe("wss://h/tp/scenes/a%20b%2Fc/stream");
  expect(streamUrl("http://h:81/scenes/pit", "north&south")).toBe("ws://h:81/scenes/pit/stream?group=north%26south");
});

describe("is refused", () => {
  it.each([
    ["quarry", "expected http"],
    ["ftp://h/scenes/pit", "expected http"],
    ["http:///scenes/pit", "expected http"],
    ["http://h:99999/scenes/pit", "expected http"],
    ["http://h/scenes/pit/segments/3.glb", "expected [/prefix]/scenes/ID"],
    ["http://h/scenespit", "expected [/prefix]/scenes/ID"],
    ["http://h/scenes/%FF", "expected UTF-8"],
    ["http://user:secret@h/scenes/pit", "credentials"],
    ["http://h/scenes/pit?token=secret", "query"],
    ["http://h/scenes/pit#secret", "fragment"],
  ])("%s", (url, reason) => {
    const error = refusalOf(() => parseSceneUrl(url));
    expect(error.code).toBe("invalid_url");
    expect(error.message).toContain(reason);
    expect(error.message).not.toContain("secret");
  });

  it("a server URL where a scene is meant", () => {
    expect(refusalOf(() => streamUrl("http://h")).message).toContain("names no scene");
  });
});

it("gives survey coordinates in float64", () => {
  const manifest = { origin: [641200.25, 8594700.125, 1241], surveyUnits: null } as const;
  expect(toSurvey(manifest, [1.5, -2, 3.0625])).toEqual([641201.75, 8594697.0625, 1239]);
  expect(toSurvey(manifest, [0, 0, 0])).toEqual(manifest.origin);
});

it("gives survey coordinates in the survey's own units", () => {
  const surveyUnits = { horizontalM: 0.25, heightM: 0.5 };
  const manifest = { origin: [1000, 2000, 50], surveyUnits } as const;
  expect(toSurvey(manifest, [1, -2, 3])).toEqual([4004, 7988, 96]);
});

it("gives survey coordinates along the survey's own axes", () => {
  const surveyUnits = { horizontalM: 0.5, heightM: 2, axes: ["south", "west", "down"] } as const;
  const manifest = { origin: [-700000, -1100000, 10], surveyUnits } as const;
  expect(toSurvey(manifest, [4, 6, 8])).toEqual([2200016, 1399992, -8]);
});

function refusalOf(step: () => unknown): StreamError {
  try {
    step();
  } catch (error) {
    if (error instanceof StreamError) return error;
    throw error;
  }
  throw new Error("expected a refusal");
}
