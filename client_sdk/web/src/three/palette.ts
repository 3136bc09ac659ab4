/**
 * The colours of the view modes, for shader and legend alike.
 *
 * PURE: no three.js, no DOM. Colours are sRGB, components 0 to 1, unless said otherwise.
 */

/** sRGB, 0 to 1. */
export type Rgb = readonly [number, number, number];

/** One mark of a legend: where it stands on the ramp (0 to 1), its value, and its CSS colour. */
export interface LegendStop {
  readonly fraction: number;
  readonly value: number;
  readonly colour: string;
}

/** Stops of a ramp in the shader; a CSS gradient through the same colours looks the same. */
export const RAMP_STOPS = 13;

/**
 * Viridis (S. van der Walt, N. Smith, matplotlib 2.0, CC0) at twelfths: lightness rises evenly, also for the colour-blind.
 */
const VIRIDIS = [
  "#440154",
  "#481f70",
  "#443983",
  "#3b528b",
  "#31688e",
  "#287c8e",
  "#21918c",
  "#20a486",
  "#35b779",
  "#5ec962",
  "#90d743",
  "#c8e020",
  "#fde725",
] as const;

/**
 * Level to vertical, at every 7.5 degrees: pale to dark brown, so that it cannot be taken for an attribute. After
 * ColorBrewer's YlOrBr (C. Brewer, M. Harrower, Apache 2.0), its nine classes spread over thirteen stops.
 */
const SLOPE = [
  "#ffffe5",
  "#fffbcf",
  "#fff4b4",
  "#fee79b",
  "#fed46f",
  "#febb47",
  "#fe9f2f",
  "#f5841f",
  "#e46a11",
  "#cf5305",
  "#b13f03",
  "#8c3005",
  "#662506",
] as const;

/** What has no value, by the page's theme: neither end of a ramp looks like it. */
export const NO_VALUE: Readonly<Record<"light" | "dark", Rgb>> = {
  light: [0.62, 0.62, 0.62],
  dark: [0.42, 0.42, 0.42],
};

/** Colour of ground without a region, or of the base where segments are told apart. */
export const PLAIN: Rgb = [0.55, 0.55, 0.53];

/** The ramp of attributes, low to high. */
export function attributeRamp(): readonly Rgb[] {
  return VIRIDIS.map(fromHex);
}

/** The ramp of slopes, 0 to 90 degrees. */
export function slopeRamp(): readonly Rgb[] {
  return SLOPE.map(fromHex);
}

/** Legend of an attribute between `min` and `max`: a linear CSS gradient through these is what is drawn. */
export function attributeLegend(min: number, max: number): readonly LegendStop[] {
  return VIRIDIS.map((colour, index) => {
    const fraction = index / (RAMP_STOPS - 1);
    return { fraction, value: min + fraction * (max - min), colour };
  });
}

/** Legend of slopes, values in degrees. */
export function slopeLegend(): readonly LegendStop[] {
  return SLOPE.map((colour, index) => ({
    fraction: index / (RAMP_STOPS - 1),
    value: (90 * index) / (RAMP_STOPS - 1),
    colour,
  }));
}

/**
 * Colour of a region by its stable id: the same in every version of a scene.
 *
 * Hues go round by the golden angle, so ids near each other get hues far apart; lightness takes three levels in turn, so
 * that two of them differ also for whoever does not tell the hues. All levels stand out from white and from black.
 */
export function regionColour(stableId: number): Rgb {
  return fromOklch(REGION_LIGHTNESS[stableId % 3]!, 0.115, 40 + stableId * GOLDEN_ANGLE_DEG);
}

/**
 * Colours of what regions are called, by name: all regions of one name have one. In the order of the alphabet, as stable ids
 * have theirs: names next to each other differ, and the legend that stands beside says which is which.
 */
export function nameColours(regions: Iterable<{ readonly label: string | null }>): ReadonlyMap<string, Rgb> {
  const names = new Set<string>();
  for (const { label } of regions) if (label !== null) names.add(label);
  return new Map([...names].sort().map((name, place) => [name, regionColour(place)]));
}

/** Colour of a segment by its id: paler than regions, and neighbours along the pack's curve differ. */
export function segmentColour(segment: number): Rgb {
  return fromOklch(SEGMENT_LIGHTNESS[segment % 3]!, 0.085, 200 + segment * GOLDEN_ANGLE_DEG);
}

/** `#rrggbb`. */
export function toCss(colour: Rgb): string {
  return `#${colour.map((channel) => toByte(channel).toString(16).padStart(2, "0")).join("")}`;
}

/** 0 to 255. */
export function toByte(channel: number): number {
  return Math.round(Math.min(Math.max(channel, 0), 1) * 255);
}

const GOLDEN_ANGLE_DEG = 137.50776405003785;
const REGION_LIGHTNESS = [0.63, 0.77, 0.48] as const;
const SEGMENT_LIGHTNESS = [0.7, 0.8, 0.6] as const;

function fromHex(hex: string): Rgb {
  const value = Number.parseInt(hex.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}

/** OKLCH to sRGB (B. Ottosson, "A perceptual color space for image processing", 2020); chroma shrinks until it fits. */
function fromOklch(lightness: number, chroma: number, hueDeg: number): Rgb {
  const hue = (hueDeg * Math.PI) / 180;
  for (let share = 1; share > 0; share -= 0.05) {
    const colour = fromOklab(lightness, share * chroma * Math.cos(hue), share * chroma * Math.sin(hue));
    if (colour.every((channel) => channel >= 0 && channel <= 1)) {
      return colour;
    }
  }
  return fromOklab(lightness, 0, 0);
}

function fromOklab(lightness: number, a: number, b: number): Rgb {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    toSrgb(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
    toSrgb(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
    toSrgb(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
  ];
}

function toSrgb(linear: number): number {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055;
}
