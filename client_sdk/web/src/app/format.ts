/** Numbers as people read them: one place, so that the page says the same thing in the same way everywhere. */

import type { BuildingScene } from "../core/types.ts";

const COUNT = new Intl.NumberFormat("en-GB", { maximumFractionDigits: 0 });
const COMPACT = new Intl.NumberFormat("en-GB", { notation: "compact", maximumSignificantDigits: 3 });

/** `152,146`; a dash where there is no number. */
export function formatCount(count: number | null | undefined): string {
  return isNumber(count) ? COUNT.format(count) : "–";
}

/** `152K`, `1.2M`: for cards and narrow places. */
export function formatCompact(count: number): string {
  return COMPACT.format(count);
}

/** Decimal units, as browsers and link speeds have them: `980 B`, `74.2 kB`, `1.13 MB`. */
export function formatBytes(bytes: number | null | undefined): string {
  if (!isNumber(bytes)) return "–";
  if (bytes < 1000) return `${Math.round(bytes)} B`;
  const units = ["kB", "MB", "GB", "TB"];
  let value = bytes / 1000;
  let unit = 0;
  while (value >= 999.5 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${significant(value)} ${units[unit]}`;
}

/** `Clean: normals, 43 %`: what a build does just now. */
export function buildingStep({ step, share }: BuildingScene): string {
  const text = `${step.slice(0, 1).toUpperCase()}${step.slice(1)}`;
  return share === null ? text : `${text}, ${Math.floor(share * 100)} %`;
}

/** `8 ms`, `640 ms`, `1.24 s`, `2 min 5 s`. */
export function formatMs(milliseconds: number | null | undefined): string {
  if (!isNumber(milliseconds)) return "–";
  if (milliseconds < 9.95) return `${milliseconds.toFixed(1)} ms`;
  if (milliseconds < 999.5) return `${Math.round(milliseconds)} ms`;
  const seconds = milliseconds / 1000;
  if (seconds < 59.95) return `${significant(seconds)} s`;
  const wholeSeconds = Math.round(seconds);
  return `${Math.floor(wholeSeconds / 60)} min ${wholeSeconds % 60} s`;
}

/** Metres with centimetres: a survey's numbers are not rounded away. `12.34 m`; above a kilometre one decimal. */
export function formatMetres(metres: number | null | undefined): string {
  if (!isNumber(metres)) return "–";
  const digits = Math.abs(metres) < 1000 ? 2 : 1;
  return `${fixed(metres, digits)} m`;
}

/** East, north or height in the survey's system: `641182.93`; a centimetre is what surveys are good for. */
export function formatCoordinate(metres: number): string {
  return fixed(metres, 2);
}

/** From one point to the next: `2.4 cm`, `35 cm`, `1.2 m`. */
export function formatSpacing(metres: number): string {
  if (metres >= 0.995) return `${metres.toFixed(1)} m`;
  const centimetres = metres * 100;
  return centimetres < 9.95 ? `${centimetres.toFixed(1)} cm` : `${Math.round(centimetres)} cm`;
}

/** A radius: `60 m`, `7.5 m`. */
export function formatRadius(metres: number | null | undefined): string {
  if (!isNumber(metres)) return "–";
  return `${metres < 10 ? trimmed(metres, 1) : COUNT.format(Math.round(metres))} m`;
}

/** How far detail reaches: `60 m`, or `60 m, coarser to 180 m`. */
export function formatReach({
  effectiveRadiusM,
  coarseRadiusM,
}: {
  readonly effectiveRadiusM: number;
  readonly coarseRadiusM: number | null;
}): string {
  const full = formatRadius(effectiveRadiusM);
  return coarseRadiusM === null ? full : `${full}, coarser to ${formatRadius(coarseRadiusM)}`;
}

/** `1,240 m²`; from ten hectares on `12.4 ha`. */
export function formatArea(squareMetres: number | null | undefined): string {
  if (!isNumber(squareMetres)) return "–";
  if (squareMetres >= 100_000) return `${significant(squareMetres / 10_000)} ha`;
  return `${squareMetres < 10 ? fixed(squareMetres, 1) : COUNT.format(squareMetres)} m²`;
}

/** `34.2°`. */
export function formatDegrees(degrees: number | null | undefined): string {
  return isNumber(degrees) ? `${fixed(degrees, 1)}°` : "–";
}

/** `93 %`. */
export function formatPercent(fraction: number | null | undefined): string {
  return isNumber(fraction) ? `${Math.round(fraction * 100)} %` : "–";
}

/** An attribute's value, to four significant digits: `2.917`, `0.0412`, `12,340`. */
export function formatValue(value: number | null | undefined): string {
  if (!isNumber(value)) return "–";
  if (value !== 0 && (Math.abs(value) >= 1e7 || Math.abs(value) < 1e-4)) return value.toExponential(3);
  return new Intl.NumberFormat("en-GB", { maximumSignificantDigits: 4 }).format(value);
}

/**
 * East, north and height for the clipboard: plain digits, millimetres, no thousands separators, so that a spreadsheet or a
 * GNSS controller takes them.
 */
export function formatSurvey(coordinates: readonly [number, number, number]): string {
  return coordinates.map((value) => fixed(value, 3)).join(" ");
}

function isNumber(value: number | null | undefined): value is number {
  return typeof value === "number" && Number.isFinite(value);
}

function significant(value: number): string {
  if (value >= 99.95) return COUNT.format(value);
  return value >= 9.995 ? value.toFixed(1) : value.toFixed(2);
}

function trimmed(value: number, digits: number): string {
  return String(Number(value.toFixed(digits)));
}

/** Like `toFixed`, without "-0.00". */
function fixed(value: number, digits: number): string {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text;
}
