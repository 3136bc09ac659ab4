/** A point of the ground: what it is, where it is, what was measured there; and distances between points. */

import { coarserPieces } from "../../core/scene/regions.ts";
import { toSurvey } from "../../core/scene/survey.ts";
import type { RegionFacts, RegionUnion, Vec3 } from "../../core/types.ts";
import { fill, h, setAttribute, setShown, setText } from "../dom.ts";
import { formatArea, formatCoordinate, formatDegrees, formatMetres, formatSurvey, formatValue } from "../format.ts";
import { icon } from "../icons.ts";
import { measurePath } from "../measure.ts";
import type { Tool, ViewerState, ViewerStore } from "../viewer/state.ts";
import { createFacts } from "./facts.ts";
import { regionName } from "./look-tab.ts";
import { createProfileSection } from "./profile-section.ts";

/** Regions of the scene version, and what the buttons do. */
export interface InspectActions {
  readonly regions: readonly RegionFacts[];
  readonly unions: readonly RegionUnion[];
  copy(text: string, subject: string): void;
  undoPoint(): void;
  /** Of the highest ground shown at (x, z); null where there is none. */
  heightAt(x: number, z: number): number | null;
}

/** Build the tab; it follows `picked` and `measured` of the store. */
export function createInspectTab(store: ViewerStore, actions: InspectActions): HTMLElement {
  const toolButton = (tool: Tool, name: string) =>
    h(
      "button",
      {
        type: "button",
        class: "button",
        "data-tool": tool,
        on: { click: () => store.set({ tool: store.get().tool === tool ? "land" : tool }) },
      },
      icon(tool),
      name,
    );
  const pickButton = toolButton("pick", "Pick a point");
  const measureButton = toolButton("measure", "Measure");

  // --- A picked point
  const pickHint = h("p", { class: "faint" });
  const pickFacts = createFacts([
    ["region", "Region"],
    ["area", "Surface area of the region"],
    ["region-slope", "Its mean slope"],
    ["within", "Part of"],
    ["east", "East"],
    ["north", "North"],
    ["height", "Height"],
    ["slope", "Slope here"],
    ["segment", "Segment"],
  ]);
  const attributes = h("dl", { class: "facts", id: "pick-attributes" });
  const crs = h("p", { class: "faint", id: "pick-crs" });
  const copyPick = h(
    "button",
    { type: "button", class: "button wide", "data-action": "copy-coordinates", on: { click: () => copyPlace() } },
    icon("copy"),
    "Copy the coordinates",
  );
  const pickSection = h(
    "section",
    { id: "picked", "aria-label": "Picked point" },
    h("h2", {}, "Point"),
    pickHint,
    pickFacts.element,
    attributes,
    crs,
    copyPick,
  );

  // --- A measured path
  const measureHint = h("p", { class: "faint" });
  const measureFacts = createFacts([
    ["straight", "Straight"],
    ["horizontal", "Horizontal"],
    ["difference", "Height difference"],
    ["gradient", "Slope"],
    ["direction", "Direction"],
    ["points", "Points"],
  ]);
  const legs = h("ol", { id: "legs", class: "legs", "aria-label": "Legs" });
  const undo = h(
    "button",
    { type: "button", class: "button", "data-action": "undo-point", on: { click: actions.undoPoint } },
    icon("undo"),
    "Undo",
  );
  const clear = h(
    "button",
    {
      type: "button",
      class: "button",
      "data-action": "clear-measure",
      on: { click: () => store.set({ measured: [] }) },
    },
    icon("delete"),
    "Clear",
  );
  const copyMeasure = h(
    "button",
    { type: "button", class: "button", "data-action": "copy-measure", on: { click: () => copyPath() } },
    icon("copy"),
    "Copy",
  );
  const measureSection = h(
    "section",
    { id: "measured", "aria-label": "Measurement" },
    h("h2", {}, "Distance"),
    measureHint,
    measureFacts.element,
    legs,
    h("div", { class: "row" }, undo, clear, copyMeasure),
  );

  // --- Positions are kept in the scene's frame; people get them in the survey's CRS.
  function surveyOf(position: Vec3): [number, number, number] {
    return toSurvey(store.get().manifest, position);
  }

  function pickedPlace(): Vec3 | null {
    const { picked } = store.get();
    if (picked === null) return null;
    return typeof picked.answer === "object" && picked.answer !== null ? picked.answer.position : picked.place;
  }

  function copyPlace(): void {
    const position = pickedPlace();
    if (position !== null) actions.copy(formatSurvey(surveyOf(position)), "Coordinates");
  }

  function copyPath(): void {
    const { measured } = store.get();
    const path = measurePath(measured);
    if (path === null) return;
    const lines = [
      "east north height",
      ...measured.map((position) => formatSurvey(surveyOf(position))),
      `straight ${path.straightM.toFixed(3)} m, horizontal ${path.horizontalM.toFixed(3)} m, height difference ${path.heightDifferenceM.toFixed(3)} m, slope ${path.direct.slopeDeg.toFixed(2)} deg`,
    ];
    actions.copy(lines.join("\n"), "Measurement");
  }

  /**
   * The point as far as it is known: what the page met at once, and the service's answer over it when that comes. The answer
   * is of full detail, and wins where both say something.
   */
  function showPick(state: ViewerState): void {
    const { picked } = state;
    const answer = picked !== null && typeof picked.answer === "object" ? picked.answer : null;
    const position = pickedPlace();
    setText(
      pickHint,
      picked === null
        ? "Choose “Pick a point”, then click the ground."
        : picked.answer === null
          ? "Asking the service…"
          : picked.answer === "none"
            ? "The survey has no full detail at this point; this is the base."
            : picked.answer === "failed"
              ? "The service does not answer just now; this is what the page itself knows."
              : "",
    );
    setShown(pickHint, picked === null || answer === null);
    // What it is, where it is, what was measured there.
    const region = actions.regions[answer?.region ?? picked?.region ?? -1];
    const survey = position === null ? null : surveyOf(position);
    const { manifest } = state;
    const isMetric = manifest.surveyUnits === null;
    const hasPick = picked !== null;
    const label = answer?.label ?? null;
    pickFacts.set("region", hasPick ? (label ?? regionName(region)) : "");
    pickFacts.set("area", region === undefined ? "" : formatArea(region.areaM2));
    pickFacts.set("region-slope", region?.slopeDeg == null ? "" : formatDegrees(region.slopeDeg));
    pickFacts.set("within", hasPick && region !== undefined ? withinText(region.id) : "");
    pickFacts.set("east", survey === null ? "" : formatCoordinate(survey[0]));
    pickFacts.set("north", survey === null ? "" : formatCoordinate(survey[1]));
    pickFacts.set("height", survey === null ? "" : `${formatCoordinate(survey[2])}${isMetric ? " m" : ""}`);
    pickFacts.set("slope", answer === null ? "" : formatDegrees(slopeOf(answer.normal)));
    const segment = answer?.segment ?? picked?.segment ?? -1;
    pickFacts.set("segment", !hasPick ? "" : segment < 0 ? "base" : String(segment));
    fill(
      attributes,
      ...Object.entries(answer?.attributes ?? {}).map(([name, value]) =>
        h(
          "div",
          { class: "fact" },
          h("dt", {}, name),
          h("dd", { class: "number", "data-attribute": name }, formatValue(value)),
        ),
      ),
    );
    setShown(crs, hasPick);
    const system =
      manifest.crs === null
        ? "The survey names no coordinate system."
        : `${manifest.crs.name}${manifest.crs.epsg === null ? "" : ` (EPSG:${manifest.crs.epsg})`}`;
    const units = `As the survey has them: in units of ${manifest.surveyUnits?.horizontalM} m`;
    const heights = `heights of ${manifest.surveyUnits?.heightM} m.`;
    const axes = manifest.surveyUnits?.axes;
    const directions = axes === undefined ? "" : ` They count ${axes[0]}, ${axes[1]} and ${axes[2]}.`;
    setText(crs, isMetric ? system : `${system} ${units}, ${heights}${directions}`);
    setShown(copyPick, hasPick);
  }

  /** Larger and larger pieces of ground: their names where they have one, and their areas. */
  function withinText(region: number): string {
    return coarserPieces(actions.regions, actions.unions, region)
      .map(({ label, areaM2 }) => `${label === null ? "" : `${label}, `}${formatArea(areaM2)}`)
      .join(" · ");
  }

  function showMeasure(state: ViewerState): void {
    const { measured } = state;
    const path = measurePath(measured);
    setText(
      measureHint,
      measured.length === 0
        ? "Choose “Measure”, then click two or more points of the ground."
        : measured.length === 1
          ? "Click the next point."
          : "",
    );
    setShown(measureHint, path === null);
    measureFacts.set("straight", path === null ? "" : formatMetres(path.straightM));
    measureFacts.set("horizontal", path === null ? "" : formatMetres(path.horizontalM));
    measureFacts.set("difference", path === null ? "" : signed(path.heightDifferenceM));
    measureFacts.set("gradient", path === null ? "" : slopeText(path.direct.slopeDeg));
    measureFacts.set("direction", path?.direct.azimuthDeg == null ? "" : formatDegrees(path.direct.azimuthDeg));
    measureFacts.set("points", measured.length < 3 ? "" : String(measured.length));
    setShown(legs, (path?.legs.length ?? 0) > 1);
    fill(
      legs,
      ...(path?.legs ?? []).map((leg) =>
        h(
          "li",
          { class: "number" },
          `${formatMetres(leg.straightM)} · ${signed(leg.heightDifferenceM)} · ${formatDegrees(leg.slopeDeg)}`,
        ),
      ),
    );
    for (const button of [undo, clear]) setShown(button, measured.length > 0);
    setShown(copyMeasure, path !== null);
  }

  // The lists are made anew only where their own part of the state differs; the rest changes while the camera moves.
  let shownState: Partial<ViewerState> = {};
  function show(state: ViewerState): void {
    setAttribute(pickButton, "aria-pressed", String(state.tool === "pick"));
    setAttribute(measureButton, "aria-pressed", String(state.tool === "measure"));
    setAttribute(element, "data-tool", state.tool);
    if (state.picked !== shownState.picked) showPick(state);
    if (state.measured !== shownState.measured) showMeasure(state);
    shownState = state;
  }

  const element = h(
    "div",
    { class: "tab-content inspect" },
    h("div", { class: "row" }, pickButton, measureButton),
    pickSection,
    measureSection,
    createProfileSection({ store, heightAt: actions.heightAt, toSurvey: surveyOf }),
  );
  store.subscribe(show);
  show(store.get());
  return element;
}

/** Angle between a face and level ground. */
function slopeOf(normal: Vec3): number {
  const size = Math.hypot(...normal);
  return size === 0 ? 0 : (Math.acos(Math.min(1, Math.abs(normal[1]) / size)) * 180) / Math.PI;
}

/** Degrees, and per cent as roads have it, where that says something. */
function slopeText(degrees: number): string {
  const percent = Math.tan((degrees * Math.PI) / 180) * 100;
  return Math.abs(degrees) > 80 ? formatDegrees(degrees) : `${formatDegrees(degrees)} (${Math.round(percent)} %)`;
}

function signed(metres: number): string {
  return `${metres > 0 ? "+" : ""}${formatMetres(metres)}`;
}
