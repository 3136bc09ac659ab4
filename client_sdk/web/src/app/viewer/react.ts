/** What follows from a change of the viewer's state: colours, markers, labels, words. */

import type { Vec3 } from "../../core/types.ts";
import { formatBytes, formatCount, formatMetres, formatMs, formatPercent, formatRadius } from "../format.ts";
import { measurePath } from "../measure.ts";
import type { Label, Labels } from "./labels.ts";
import type { Parts } from "./parts.ts";
import type { Landed, ViewerState } from "./state.ts";

/** Follow the store. */
export function reactToState(parts: Parts, labels: Labels): () => void {
  return parts.store.subscribe((state, before) => {
    const { stage, markers, loop, listeners, shell } = parts;
    if (state.mode !== before.mode) stage.setMode(state.mode, shell.theme.theme);
    if (state.highlightedRegion !== before.highlightedRegion) stage.highlightRegion(state.highlightedRegion);
    if (state.aim?.place !== before.aim?.place) markers.setAim(state.aim, arcStart(parts, state), parts.camera.eye);
    if (state.aim?.fraction !== before.aim?.fraction) markers.setFraction(state.aim?.fraction ?? null);
    if (state.radiusM !== before.radiusM && state.aim !== null && state.aim.radiusM !== state.radiusM) {
      parts.desk.aim(state.aim.place, state.radiusM);
    }
    if (state.measured !== before.measured) markers.setPath(state.measured);
    if (state.tool !== before.tool && state.tool !== "land") parts.desk.cancelAim();
    if (state.mode !== before.mode) parts.link.follow(parts.going.settledRoute);
    if (
      state.aim !== before.aim ||
      state.picked?.place !== before.picked?.place ||
      state.measured !== before.measured
    ) {
      labels.set(labelsOf(state));
    }
    if (state.outside !== before.outside || state.view !== before.view) sayWhereDetailEnds(parts, state);
    listeners.emit("state", state);
    loop.request();
  });
}

/**
 * Where the arc to an aim begins: at the walker's eye. From above there is nobody to start from but where the last landing
 * was; without one it drops on the place from above.
 */
function arcStart({ camera }: Parts, { aim, landed, view }: ViewerState): Vec3 {
  if (view === "walk" || aim === null) return camera.eye;
  const [x, y, z] = aim.place;
  return landed?.place ?? [x, y + aim.radiusM * 0.6, z];
}

function labelsOf({ aim, picked, measured }: ViewerState): readonly Label[] {
  const labels: Label[] = [];
  if (aim !== null) {
    const ready = aim.fraction === null ? "" : aim.fraction >= 1 ? " · ready" : ` · ${formatPercent(aim.fraction)}`;
    labels.push({ place: aim.place, kind: "aim", text: `${formatRadius(aim.radiusM)}${ready}` });
  }
  if (picked !== null) labels.push({ place: picked.place, kind: "pick", text: "" });
  for (const place of measured) labels.push({ place, kind: "measure", text: "" });
  for (const [index, leg] of (measurePath(measured)?.legs ?? []).entries()) {
    labels.push({
      place: middle(measured[index]!, measured[index + 1]!),
      kind: "length",
      text: formatMetres(leg.straightM),
    });
  }
  return labels;
}

function sayWhereDetailEnds({ notices }: Parts, { outside, view }: ViewerState): void {
  if (!outside || view !== "walk") {
    notices.clear("edge");
    return;
  }
  notices.show({
    key: "edge",
    tone: "info",
    title: "Detail ends here",
    text: "Beyond this point only the base is shown. Click the ground ahead, and again to land there.",
    remedies: [],
  });
}

/** A landing that was shown, in words. */
export function landedText(landed: Landed, isCompletion: boolean): string {
  const size = `${formatCount(landed.triangles)} triangles within ${formatRadius(landed.effectiveRadiusM)}`;
  if (landed.degraded) return "The connection is slow: the middle of the landing is shown, the rest follows.";
  if (isCompletion) return `The landing is complete: ${size}.`;
  const bytes = landed.bytes === 0 ? "nothing had to be loaded" : `${formatBytes(landed.bytes)} loaded`;
  return `Landed: ${size}, ${bytes}, ready after ${formatMs(landed.readyMs)}.`;
}

function middle(a: Vec3, b: Vec3): Vec3 {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2];
}
