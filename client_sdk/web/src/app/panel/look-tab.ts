/** How the ground is coloured, and what the colours mean. */

import type { RegionFacts } from "../../core/types.ts";
import { attributeLegend, type LegendStop, nameColours, slopeLegend, toCss } from "../../three/palette.ts";
import type { ViewMode } from "../../three/types.ts";
import { attributeMode, keyOfMode, modesOf } from "../../three/view-modes.ts";
import { fill, h, setAttribute } from "../dom.ts";
import { formatArea, formatValue } from "../format.ts";
import type { ViewerState, ViewerStore } from "../viewer/state.ts";

/** Regions of the scene version, with the colours that the shader gives them. */
export interface LookSources {
  readonly regions: readonly RegionFacts[];
  regionColour(id: number): string;
}

/** Regions that the legend lists at once; the rest behind a button. */
const LISTED_REGIONS = 40;

/** Build the tab; legends are made anew where the mode changes, not for every state. */
export function createLookTab(store: ViewerStore, sources: LookSources): HTMLElement {
  const choices = modesOf(store.get().manifest, sources.regions);
  // The modes of a scene version never change: the radio buttons are made once.
  const inputs = choices.map((choice) => {
    const input = h("input", {
      type: "radio",
      name: "mode",
      value: keyOfMode(choice.mode),
      on: { change: () => store.set({ mode: choice.mode, highlightedRegion: null }) },
    });
    return { choice, input };
  });
  const legend = h("div", { id: "legend", class: "legend" });
  const element = h(
    "div",
    { class: "tab-content" },
    h(
      "fieldset",
      { id: "modes", class: "modes" },
      h("legend", {}, "Colour the ground by"),
      ...inputs.map(({ choice, input }) =>
        h(
          "label",
          { class: "choice", "data-mode": keyOfMode(choice.mode) },
          input,
          h("span", {}, choice.name),
          h("span", { class: "faint" }, choice.hint),
        ),
      ),
    ),
    legend,
  );
  let shownKey = "";
  let listsAll = false;

  function show(state: ViewerState): void {
    // The legend is made anew for another mode alone: under a moving range or highlight its inputs keep the focus.
    const key = keyOfMode(state.mode);
    for (const { choice, input } of inputs) input.checked = keyOfMode(choice.mode) === key;
    if (key !== shownKey) {
      shownKey = key;
      listsAll = false;
      drawLegend(state);
    } else if (state.mode.kind === "regions") {
      markHighlighted(state.highlightedRegion);
    } else if (state.mode.kind === "attribute") {
      labelRamp(attributeLegend(state.mode.min, state.mode.max));
    }
  }

  function drawLegend(state: ViewerState): void {
    const { mode } = state;
    if (mode.kind === "regions") drawRegions(state);
    else if (mode.kind === "names") drawNames();
    else if (mode.kind === "attribute") drawAttribute(mode);
    else if (mode.kind === "slope") {
      fill(
        legend,
        h("h2", {}, "Slope"),
        ramp(slopeLegend(), (value) => `${Math.round(value)}°`),
      );
    } else if (mode.kind === "segments") {
      fill(
        legend,
        h(
          "p",
          { class: "faint" },
          "Each colour is one segment, the piece in which detail is streamed. The base is pale.",
        ),
      );
    } else fill(legend);
  }

  function drawRegions(state: ViewerState): void {
    const byArea = sources.regions.toSorted((a, b) => (b.areaM2 ?? 0) - (a.areaM2 ?? 0));
    const listed = listsAll ? byArea : byArea.slice(0, LISTED_REGIONS);
    const hiddenCount = byArea.length - listed.length;
    const more = h(
      "button",
      {
        type: "button",
        class: "button wide",
        on: {
          click: () => {
            listsAll = true;
            drawRegions(store.get());
          },
        },
      },
      `Show ${hiddenCount} more`,
    );
    fill(
      legend,
      h("h2", { id: "regions-title" }, `Regions (${byArea.length})`),
      h("p", { class: "faint" }, "Choose one to see it alone in colour. Pale: ground whose region is not known."),
      h("ul", { class: "regions", "aria-labelledby": "regions-title" }, ...listed.map(regionRow)),
      hiddenCount > 0 && more,
    );
    markHighlighted(state.highlightedRegion);
  }

  /** One row a name, largest area first; what has none is pale on the ground, and last here. */
  function drawNames(): void {
    const groups = groupsByName(sources.regions);
    const colours = nameColours(sources.regions);
    const whole = groups.reduce((sum, { areaM2 }) => sum + areaM2, 0);
    fill(
      legend,
      h("h2", { id: "names-title" }, "Names"),
      h(
        "ul",
        { class: "regions", "aria-labelledby": "names-title" },
        ...groups.map(({ name, count, areaM2 }) => {
          const colour = colours.get(name ?? "");
          const swatch = h("span", { class: "swatch", "aria-hidden": "true" });
          if (colour !== undefined) swatch.style.background = toCss(colour);
          const share = whole > 0 ? `, ${((100 * areaM2) / whole).toFixed(1)} %` : "";
          return h(
            "li",
            { class: "region", "data-name": name ?? "" },
            swatch,
            h("span", { class: "region-name" }, name ?? "without a name"),
            h("span", { class: "faint number" }, `${count} × · ${formatArea(areaM2)}${share}`),
          );
        }),
      ),
    );
  }

  function regionRow(region: RegionFacts): HTMLElement {
    const swatch = h("span", { class: "swatch", "aria-hidden": "true" });
    swatch.style.background = sources.regionColour(region.id);
    const button = h(
      "button",
      {
        type: "button",
        class: "region",
        "data-region": region.id,
        "aria-pressed": "false",
        on: {
          click: () => {
            const { highlightedRegion } = store.get();
            store.set({ highlightedRegion: highlightedRegion === region.id ? null : region.id });
          },
        },
      },
      swatch,
      h("span", { class: "region-name" }, regionName(region)),
      h("span", { class: "faint number" }, formatArea(region.areaM2)),
    );
    return h("li", {}, button);
  }

  function markHighlighted(id: number | null): void {
    for (const button of legend.querySelectorAll<HTMLElement>("[data-region]")) {
      setAttribute(button, "aria-pressed", String(Number(button.dataset.region) === id));
    }
  }

  /**
   * Ramp and range of an attribute. A bound takes effect only where both together are a range; until then it is marked
   * invalid and the ground keeps its colours.
   */
  function drawAttribute(mode: ViewMode & { kind: "attribute" }): void {
    const info = store.get().manifest.attributes.find(({ name }) => name === mode.name);
    const bound = (key: "min" | "max", title: string) => {
      const input = h("input", {
        id: `range-${key}`,
        type: "number",
        step: "any",
        value: Number(mode[key].toPrecision(5)),
        on: {
          change: () => {
            // The range as it is now, not as it was when the legend was drawn: the other bound may have changed since.
            const { mode: current } = store.get();
            if (current.kind !== "attribute") return;
            const next = { ...current, [key]: Number(input.value) };
            const isRange = input.value !== "" && Number.isFinite(next.min) && next.min < next.max;
            setAttribute(input, "aria-invalid", isRange ? null : "true");
            if (isRange) store.set({ mode: next });
          },
        },
      });
      return h("div", {}, h("label", { for: `range-${key}` }, title), input);
    };
    const wholeRangeButton = h(
      "button",
      {
        type: "button",
        class: "button",
        on: {
          click: () => {
            store.set({ mode: attributeMode(mode.name, info?.min ?? null, info?.max ?? null) });
            drawLegend(store.get());
          },
        },
      },
      "Whole range",
    );
    fill(
      legend,
      h("h2", {}, mode.name),
      ramp(attributeLegend(mode.min, mode.max), formatValue),
      h("div", { class: "range-fields" }, bound("min", "From"), bound("max", "To"), wholeRangeButton),
      h(
        "p",
        { class: "faint" },
        `In the scene: ${formatValue(info?.min)} to ${formatValue(info?.max)}. Grey has no value.`,
      ),
    );
  }

  function labelRamp(stops: readonly LegendStop[]): void {
    const labels = legend.querySelectorAll(".ramp-values span");
    const middle = stops[(stops.length - 1) / 2];
    for (const [index, stop] of [stops[0], middle, stops[stops.length - 1]].entries()) {
      const label = labels[index];
      if (label !== undefined && stop !== undefined) label.textContent = formatValue(stop.value);
    }
  }

  store.subscribe(show);
  show(store.get());
  return element;
}

/** Regions by what they are called, largest area first; those without a name (null) last. */
export function groupsByName(
  regions: readonly RegionFacts[],
): readonly { readonly name: string | null; readonly count: number; readonly areaM2: number }[] {
  const groups = new Map<string | null, { name: string | null; count: number; areaM2: number }>();
  for (const { label, areaM2 } of regions) {
    const group = groups.get(label) ?? { name: label, count: 0, areaM2: 0 };
    group.count += 1;
    group.areaM2 += areaM2 ?? 0;
    groups.set(label, group);
  }
  return [...groups.values()].sort((a, b) => Number(a.name === null) - Number(b.name === null) || b.areaM2 - a.areaM2);
}

/** What a region is called. */
export function regionName(region: RegionFacts | undefined): string {
  if (region === undefined) return "no region";
  return region.label ?? `Region ${region.stableId ?? region.id}`;
}

function ramp(stops: readonly LegendStop[], text: (value: number) => string): HTMLElement {
  const band = h("div", { class: "ramp" });
  const colours = stops.map(({ colour, fraction: stop }) => `${colour} ${(stop * 100).toFixed(1)}%`);
  band.style.background = `linear-gradient(to right, ${colours.join(", ")})`;
  const marks = [stops[0]!, stops[(stops.length - 1) / 2]!, stops[stops.length - 1]!];
  return h(
    "div",
    {},
    band,
    h("div", { class: "ramp-values number" }, ...marks.map(({ value }) => h("span", {}, text(value)))),
  );
}
