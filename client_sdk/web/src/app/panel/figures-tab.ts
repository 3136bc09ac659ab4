/** Numbers for whoever wants to know how it runs, and for whoever is asked for help. */

import type { TerrainStats } from "../../three/types.ts";
import { h, setAttribute, setText } from "../dom.ts";
import { formatBytes, formatCount, formatMs, formatPercent } from "../format.ts";
import { type FrameSummary, summariseFrames } from "../frame-times.ts";
import { icon } from "../icons.ts";
import type { ViewerState, ViewerStore } from "../viewer/state.ts";
import { createFacts } from "./facts.ts";
import { drawSparkline } from "./sparkline.ts";

/** Where the numbers come from. */
export interface FigureSources {
  stats(): TerrainStats;
  readonly frames: readonly number[];
  copyDiagnostics(): void;
}

/** Figures change in every frame: the tab reads them when told to, not by itself. */
export interface FiguresTab {
  readonly element: HTMLElement;
  /** Read the numbers anew; called some times a second while the tab is open. */
  refresh(): void;
}

/** Build the tab, and read the figures once. */
export function createFiguresTab(store: ViewerStore, sources: FigureSources): FiguresTab {
  const comfort = h("p", { id: "comfort", class: "comfort" });
  const spark = h("canvas", { class: "spark", role: "img" });
  const frame = createFacts([
    ["frame-median", "Median"],
    ["frame-p95", "95 of 100 within"],
    ["frame-max", "Longest"],
    ["update-max", "Longest upload slice"],
  ]);
  const landing = createFacts([
    ["landing-time", "Ready after"],
    ["landing-bytes", "Bytes"],
    ["hit-rate", "Landings that an aim foresaw"],
    ["total-bytes", "Loaded since the start"],
    ["held", "Held in memory"],
  ]);
  const drawn = createFacts([
    ["visible-segments", "Segments shown"],
    ["visible-triangles", "Triangles shown"],
    ["gpu", "Memory on the GPU"],
    ["gpu-turnover", "Created and freed"],
  ]);
  const copy = h(
    "button",
    {
      type: "button",
      class: "button wide",
      "data-action": "copy-diagnostics",
      on: { click: () => sources.copyDiagnostics() },
    },
    icon("copy"),
    "Copy diagnostics",
  );
  const element = h(
    "div",
    { class: "tab-content" },
    comfort,
    h("h2", {}, "Frames"),
    spark,
    frame.element,
    h("p", { class: "faint" }, "Drawn only when something changes; rests are not counted."),
    h("h2", {}, "Landings"),
    landing.element,
    h("h2", {}, "Drawn"),
    drawn.element,
    copy,
  );

  function refresh(): void {
    const state = store.get();
    const stats = sources.stats();
    const summary = summariseFrames(sources.frames);
    setText(comfort, comfortText(state));
    setAttribute(comfort, "data-kept", String(state.strayChanges === 0));
    drawSparkline(spark, sources.frames);
    setAttribute(spark, "aria-label", sparkText(summary));
    frame.set("frame-median", formatMs(summary?.medianMs));
    frame.set("frame-p95", formatMs(summary?.p95Ms));
    frame.set("frame-max", formatMs(summary?.maxMs));
    frame.set("update-max", formatMs(stats.updateMaxMs));

    // The newest landing, and all of them.
    const { landed } = state;
    landing.set("landing-time", landed === null ? "–" : formatMs(landed.readyMs));
    landing.set("landing-bytes", landed === null ? "–" : formatBytes(landed.bytes));
    const { stream } = stats;
    const hits = stream === null || stream.aimedLandings === 0 ? null : stream.aimHits / stream.aimedLandings;
    landing.set(
      "hit-rate",
      hits === null ? "–" : `${formatPercent(hits)} (${stream?.aimHits} of ${stream?.aimedLandings})`,
    );
    landing.set("total-bytes", formatBytes(stream?.payloadBytes));
    landing.set(
      "held",
      stream === null ? "–" : `${formatBytes(stream.heldBytes)} (${formatCount(stream.heldSegments)})`,
    );

    // What is drawn, and what it takes.
    const { gpu } = stats;
    drawn.set("visible-segments", formatCount(gpu.visibleSegments));
    drawn.set("visible-triangles", formatCount(stats.visibleTriangles));
    drawn.set("gpu", formatBytes(gpu.bufferBytes + gpu.textureBytes));
    drawn.set("gpu-turnover", `${formatBytes(gpu.createdBytes)} / ${formatBytes(gpu.freedBytes)}`);
  }

  refresh();
  return { element, refresh };
}

/** The comfort rule, counted. A landing where all is shown already changes nothing. */
export function comfortText(state: Pick<ViewerState, "swaps" | "visibleChanges" | "strayChanges">): string {
  const count = (number: number, singular: string) => `${formatCount(number)} ${singular}${number === 1 ? "" : "s"}`;
  const counts = `${count(state.swaps, "landing")}, ${count(state.visibleChanges, "change")}`;
  return state.strayChanges === 0
    ? `What is visible has changed only at landings: ${counts}.`
    : `What is visible has changed outside landings ${count(state.strayChanges, "time")} (${counts}). Please report this.`;
}

function sparkText(summary: FrameSummary | null): string {
  return summary === null
    ? "Frame times: none yet"
    : `Frame times of the last ${summary.count} frames: median ${formatMs(summary.medianMs)}, longest ${formatMs(summary.maxMs)}`;
}
