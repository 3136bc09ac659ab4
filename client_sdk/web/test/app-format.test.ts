/** Numbers as people read them. */

import { expect, test } from "vitest";
import {
  formatArea,
  formatBytes,
  formatCoordinate,
  formatDegrees,
  formatMetres,
  formatMs,
  formatPercent,
  formatRadius,
  formatSurvey,
  formatValue,
} from "../src/app/format.ts";

test.each([
  [0, "0 B"],
  [999, "999 B"],
  [1000, "1.00 kB"],
  [74_240, "74.2 kB"],
  [999_400, "999 kB"],
  [999_600, "1.00 MB"],
  [1_130_292, "1.13 MB"],
  [5e12, "5.00 TB"],
  [7e15, "7,000 TB"],
])("%d bytes are %s", (bytes, text) => {
  expect(formatBytes(bytes)).toBe(text);
});

test.each([
  [0.04, "0.0 ms"],
  [8.4, "8.4 ms"],
  [9.96, "10 ms"],
  [640, "640 ms"],
  [999.6, "1.00 s"],
  [12_340, "12.3 s"],
  [59_960, "1 min 0 s"],
  [125_000, "2 min 5 s"],
])("%d milliseconds are %s", (ms, text) => {
  expect(formatMs(ms)).toBe(text);
});

test("lengths keep the centimetre, and never say minus zero", () => {
  expect(formatMetres(12.345)).toBe("12.35 m");
  expect(formatMetres(-0.001)).toBe("0.00 m");
  expect(formatMetres(1234.56)).toBe("1234.6 m");
  expect(formatCoordinate(8_594_672.914)).toBe("8594672.91");
  expect(formatRadius(7.54)).toBe("7.5 m");
  expect(formatRadius(60.4)).toBe("60 m");
});

test("survey coordinates are digits that a spreadsheet takes", () => {
  expect(formatSurvey([641182.9126, 8594672.9, -0.0001])).toBe("641182.913 8594672.900 0.000");
});

test("areas, angles, parts and values", () => {
  expect(formatArea(4648.4)).toBe("4,648 m²");
  expect(formatArea(5.25)).toBe("5.3 m²");
  expect(formatArea(123_456)).toBe("12.3 ha");
  expect(formatDegrees(-0.01)).toBe("0.0°");
  expect(formatPercent(0.935)).toBe("94 %");
  expect(formatValue(2.91682)).toBe("2.917");
  expect(formatValue(0.00001234)).toBe("1.234e-5");
});

test("what is not known is a dash", () => {
  for (const format of [formatBytes, formatMs, formatMetres, formatRadius, formatArea, formatDegrees, formatValue]) {
    expect([format(null), format(undefined), format(Number.NaN)]).toEqual(["–", "–", "–"]);
  }
});
