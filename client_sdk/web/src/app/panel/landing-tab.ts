/** Where the user landed, how far the detail reaches, and how the next landing is made. */

import { coarseRadiusOf } from "../../core/landing-defaults.ts";
import { fill, h, setShown, setText } from "../dom.ts";
import { formatBytes, formatCount, formatMs, formatPercent, formatRadius, formatReach } from "../format.ts";
import { icon } from "../icons.ts";
import { gainText } from "../viewer/compare.ts";
import type { ViewerState, ViewerStore } from "../viewer/state.ts";
import { createFacts } from "./facts.ts";

/** What the buttons do. */
export interface LandingActions {
  land(): void;
  cancel(): void;
  copyLink(): void;
  savePicture(): void;
  aimAtCentre(): void;
}

/** Smallest radius of the slider, metres. */
const MIN_RADIUS_M = 1;
/** A slider over all that the server allows would have its useful part in the first tenth: it is logarithmic. */
const STEPS = 100;

const BUDGET_NAMES: Readonly<Record<string, string>> = {
  max_triangles: "triangles",
  max_bytes: "bytes",
  max_segments: "segments",
};

/** Build the tab; it follows the store. */
export function createLandingTab(store: ViewerStore, actions: LandingActions): HTMLElement {
  const status = h("p", { id: "landing-status", class: "status-line" });
  const bar = h("div", {});
  const progress = h(
    "div",
    {
      id: "landing-progress",
      class: "progress",
      role: "progressbar",
      "aria-label": "Detail of the landing",
      "aria-valuemin": 0,
      "aria-valuemax": 100,
    },
    bar,
  );
  const landButton = h(
    "button",
    { type: "button", class: "button primary", "data-action": "land", on: { click: actions.land } },
    icon("land"),
    "Land there",
  );
  const cancelButton = h(
    "button",
    { type: "button", class: "button", "data-action": "cancel-aim", on: { click: actions.cancel } },
    "Cancel",
  );
  const aimButton = h(
    "button",
    { type: "button", class: "button", "data-action": "aim-centre", on: { click: actions.aimAtCentre } },
    "Aim at the centre",
  );
  const facts = createFacts([
    ["radius", "Detail reaches"],
    ["segments", "Segments"],
    ["triangles", "Triangles"],
    ["bytes", "Loaded"],
    ["time", "Ready after"],
    ["shown", "Shown after"],
  ]);
  const gain = h("p", { id: "landing-gain", class: "hint" });
  const omittedHint = h("p", { id: "landing-cut", class: "hint" });

  // --- The next landing
  const slider = h("input", {
    id: "radius",
    type: "range",
    min: 0,
    max: STEPS,
    step: 1,
    "aria-describedby": "radius-hint",
    on: {
      input: () => store.set({ radiusM: toRadius(Number(slider.value), maxOf(store.get())) }),
    },
  });
  const output = h("output", { for: "radius", class: "number" });
  const hint = h("p", { id: "radius-hint", class: "faint" });
  const brings = h("input", {
    id: "brings-camera",
    type: "checkbox",
    on: { change: () => store.set({ bringsCamera: brings.checked }) },
  });
  const coarse = h("input", {
    id: "shows-coarse",
    type: "checkbox",
    on: { change: () => store.set({ showsCoarse: coarse.checked }) },
  });
  const coarseText = h("span", {});
  const coarseChoice = h("label", { class: "choice", for: "shows-coarse" }, coarse, coarseText);
  const copy = h(
    "button",
    { type: "button", class: "button wide", "data-action": "copy-link", on: { click: actions.copyLink } },
    icon("link"),
    "Copy a link to this place",
  );
  const picture = h(
    "button",
    { type: "button", class: "button wide", "data-action": "save-picture", on: { click: actions.savePicture } },
    icon("report"),
    "Save this picture",
  );

  const element = h(
    "div",
    { class: "tab-content" },
    status,
    progress,
    h("div", { class: "row" }, landButton, cancelButton, aimButton),
    facts.element,
    gain,
    omittedHint,
    h(
      "div",
      { class: "field" },
      h("div", { class: "field-head" }, h("label", { for: "radius" }, "Radius of the next landing"), output),
      slider,
      hint,
    ),
    coarseChoice,
    h("label", { class: "choice", for: "brings-camera" }, brings, "Take me to the ground where I land"),
    copy,
    picture,
  );

  function show(state: ViewerState): void {
    // An aim's progress goes before a landing's: it is what the user looks at next.
    const { landing, landed, aim } = state;
    setText(status, statusText(state));
    const isLoading = landing !== null && (landing.phase === "planning" || landing.phase === "streaming");
    const fraction = aim === null && isLoading ? landing.fraction : null;
    setShown(progress, fraction !== null);
    progress.setAttribute("aria-valuenow", String(Math.round((fraction ?? 0) * 100)));
    bar.style.transform = `scaleX(${fraction ?? 0})`;
    setShown(landButton, aim !== null);
    setShown(cancelButton, aim !== null);
    setShown(aimButton, aim === null);

    facts.set("radius", landed === null ? "" : formatReach(landed));
    facts.set("segments", landed === null ? "" : formatCount(landed.segments));
    facts.set("triangles", landed === null ? "" : formatCount(landed.triangles));
    facts.set("bytes", landed === null ? "" : landed.bytes === 0 ? "nothing, all was here" : formatBytes(landed.bytes));
    facts.set("time", landed === null ? "" : formatMs(landed.readyMs));
    facts.set("shown", landed === null ? "" : formatMs(landed.shownMs));
    setShown(omittedHint, landed?.omittedBy != null || (landed?.missing ?? 0) > 0 || landed?.degraded === true);
    fill(omittedHint, ...cutTexts(state));
    setShown(gain, state.gain !== null);
    setText(gain, state.gain === null ? "" : gainText(state.gain));

    slider.value = String(toStep(state.radiusM, maxOf(state)));
    const radius = formatRadius(state.radiusM);
    setText(output, radius);
    slider.setAttribute("aria-valuetext", radius);
    setText(
      hint,
      state.maxRadiusM === null
        ? "Detail is shown within this distance of where you land."
        : `Detail is shown within this distance. The service allows ${formatRadius(state.maxRadiusM)}.`,
    );
    brings.checked = state.bringsCamera;
    const coarseM = coarseRadiusOf(state.radiusM, state.manifest);
    setShown(coarseChoice, coarseM !== undefined);
    coarse.checked = state.showsCoarse;
    const reachM = Math.min(coarseM ?? 0, maxOf(state));
    setText(coarseText, `Coarser detail around it, to ${formatRadius(reachM)}`);
  }

  store.subscribe(show);
  show(store.get());
  return element;
}

/** The landing in one sentence. */
export function statusText({ landing, landed, aim }: ViewerState): string {
  if (aim !== null) {
    return `Aimed. ${aim.bytes === 0 ? "Asking for the ground there…" : `${formatBytes(aim.bytes)} loaded ahead.`}`;
  }
  if (landing?.phase === "planning") return "Landing: asking for the ground…";
  if (landing?.phase === "streaming" || landing?.phase === "degraded-presentable") {
    const ofBytes = landing.plan === null ? "" : ` of ${formatBytes(landing.plan.loadBytes)}`;
    if (landed?.degraded) return `The middle is shown; ${formatPercent(landing.fraction)}${ofBytes} is here.`;
    return `Landing: ${formatPercent(landing.fraction)}${ofBytes} is here.`;
  }
  if (landed !== null) return landed.degraded ? "Landed, with the middle of the detail only." : "Landed.";
  return "Click the ground to go there, in full detail.";
}

function cutTexts({ landed }: ViewerState): string[] {
  if (landed === null) return [];
  const texts: string[] = [];
  if (landed.omittedBy !== null) {
    const budget = BUDGET_NAMES[landed.omittedBy] ?? landed.omittedBy;
    const ends =
      landed.coarseRadiusM === null
        ? `Detail ends at ${formatRadius(landed.effectiveRadiusM)} instead of ${formatRadius(landed.radiusM)}`
        : `The coarser detail ends at ${formatRadius(landed.coarseRadiusM)}`;
    texts.push(`${ends}: this device's budget of ${budget} is used up. `);
  }
  if (landed.missing > 0) {
    texts.push(
      `${formatCount(landed.missing)} segments could not be had; the base is shown there. Landing again tries again. `,
    );
  }
  if (landed.degraded) texts.push("The rest follows as it comes.");
  return texts;
}

function maxOf(state: ViewerState): number {
  return Math.max(MIN_RADIUS_M * 2, state.maxRadiusM ?? 500);
}

function toRadius(step: number, maxM: number): number {
  const exact = MIN_RADIUS_M * (maxM / MIN_RADIUS_M) ** (step / STEPS);
  return Math.min(
    maxM,
    exact < 10 ? Math.round(exact * 2) / 2 : exact < 20 ? Math.round(exact) : Math.round(exact / 5) * 5,
  );
}

function toStep(radiusM: number, maxM: number): number {
  return Math.round((STEPS * Math.log(Math.max(radiusM, MIN_RADIUS_M) / MIN_RADIUS_M)) / Math.log(maxM / MIN_RADIUS_M));
}
