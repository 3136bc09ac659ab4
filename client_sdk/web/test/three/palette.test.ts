import { describe, expect, it } from "vitest";

import {
  attributeLegend,
  attributeRamp,
  NO_VALUE,
  RAMP_STOPS,
  type Rgb,
  regionColour,
  segmentColour,
  slopeLegend,
  slopeRamp,
  toCss,
} from "../../src/three/palette.ts";

function linear(channel: number): number {
  return channel <= 0.04045 ? channel / 12.92 : ((channel + 0.055) / 1.055) ** 2.4;
}

/** WCAG 2.2. */
function luminance([r, g, b]: Rgb): number {
  return 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
}

function contrast(a: Rgb, b: Rgb): number {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

/** OKLab of linear light: distances of about 0.02 are just seen. */
function oklab([r, g, b]: readonly [number, number, number]): [number, number, number] {
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

/** G. Machado and others, "A physiologically-based model for simulation of color vision deficiency", 2009, severity 1. */
const EYES: Record<string, readonly (readonly [number, number, number])[]> = {
  full: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  protan: [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
  ],
  deutan: [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.01182, 0.04294, 0.968881],
  ],
  tritan: [
    [1.255528, -0.076749, -0.178779],
    [-0.078411, 0.930809, 0.147602],
    [0.004733, 0.691367, 0.3039],
  ],
};

function seenBy(colour: Rgb, eye: string): [number, number, number] {
  const light = colour.map(linear);
  const mixed = EYES[eye]!.map((row) => Math.max(row[0] * light[0]! + row[1] * light[1]! + row[2] * light[2]!, 0));
  return oklab(mixed as [number, number, number]);
}

function apart(a: Rgb, b: Rgb, eye: string): number {
  const [x, y] = [seenBy(a, eye), seenBy(b, eye)];
  return Math.hypot(x[0] - y[0], x[1] - y[1], x[2] - y[2]);
}

describe("regions", () => {
  it("have the same colour for the same stable id, always", () => {
    expect([0, 1, 2, 77].map((id) => toCss(regionColour(id)))).toMatchInlineSnapshot(`
      [
        "#c36f52",
        "#52ccb3",
        "#76478a",
        "#0c6c66",
      ]
    `);
  });

  it.each(Object.keys(EYES))("with ids near each other differ for %s sight", (eye) => {
    for (let id = 0; id < 1000; id += 1) {
      expect(apart(regionColour(id), regionColour(id + 1), eye)).toBeGreaterThan(0.05);
      expect(apart(regionColour(id), regionColour(id + 2), eye)).toBeGreaterThan(0.05);
    }
  });

  it("stand out from a light page and from a dark one", () => {
    for (let id = 0; id < 300; id += 1) {
      expect(contrast(regionColour(id), [1, 1, 1])).toBeGreaterThan(1.9);
      expect(contrast(regionColour(id), [0.07, 0.07, 0.07])).toBeGreaterThan(2.4);
    }
  });
});

describe("segments", () => {
  it("next to each other in the pack differ", () => {
    for (let id = 0; id < 1000; id += 1) {
      expect(apart(segmentColour(id), segmentColour(id + 1), "full")).toBeGreaterThan(0.08);
    }
  });
});

describe("ramps", () => {
  it.each([
    ["attribute", attributeRamp(), 1],
    ["slope", slopeRamp(), -1],
  ] as const)("%s: lightness goes one way, in even steps, for everybody", (_name, ramp, sign) => {
    expect(ramp).toHaveLength(RAMP_STOPS);
    for (const eye of ["full", "protan", "deutan"]) {
      const lightness = ramp.map((colour) => sign * seenBy(colour, eye)[0]);
      lightness.slice(1).forEach((value, index) => {
        expect(value).toBeGreaterThan(lightness[index]!);
      });
    }
  });

  it("do not contain the grey of no value", () => {
    for (const grey of Object.values(NO_VALUE)) {
      for (const colour of [...attributeRamp(), ...slopeRamp()]) {
        expect(apart(grey, colour, "full")).toBeGreaterThan(0.05);
      }
    }
  });

  it("have legends of the very colours that the shader is given", () => {
    const legend = attributeLegend(2, 8);
    expect(legend.map(({ colour }) => colour)).toEqual(attributeRamp().map(toCss));
    expect(legend[0]).toMatchObject({ fraction: 0, value: 2 });
    expect(legend.at(-1)).toMatchObject({ fraction: 1, value: 8 });
    expect(slopeLegend().map(({ value }) => value)).toEqual([
      0, 7.5, 15, 22.5, 30, 37.5, 45, 52.5, 60, 67.5, 75, 82.5, 90,
    ]);
    expect(slopeLegend().map(({ colour }) => colour)).toEqual(slopeRamp().map(toCss));
  });
});
