/** What follows from a change of the viewer's state: colours, markers, labels, words. */

import type { Vec3 } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import { formatMetres, formatPercent, formatRadius } from "../format.ts";
import { measurePath } from "../measure.ts";
import type { Route } from "../route.ts";
import type { ThemeSwitch } from "../theme.ts";
import type { CameraDesk } from "./camera-desk.ts";
import type { EmbedListeners } from "./embed.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { Label, Labels } from "./labels.ts";
import type { LandingDesk } from "./landing-desk.ts";
import type { Markers } from "./markers.ts";
import type { Notices } from "./notices.ts";
import type { PlaceLink } from "./place-link.ts";
import type { ViewerState, ViewerStore } from "./state.ts";

/** What a change of state reaches. */
export interface Reactors {
  readonly store: ViewerStore;
  readonly stage: Terrain;
  readonly camera: CameraDesk;
  readonly desk: LandingDesk;
  readonly markers: Markers;
  readonly labels: Labels;
  readonly notices: Notices;
  readonly link: PlaceLink;
  readonly listeners: EmbedListeners;
  readonly loop: FrameLoop;
  readonly theme: ThemeSwitch;
  /** The address of what is shown; null while the user is on his way elsewhere. */
  readonly settledRoute: () => Route | null;
}

/** Follow the store; returns how to stop. */
export function reactToState(reactors: Reactors): () => void {
  const { store, stage, camera, desk, markers, labels, notices, link, listeners, loop, theme, settledRoute } = reactors;
  return store.subscribe((state, before) => {
    // Each module follows its own fields; one frame is asked for at the end, for all of them.
    if (state.mode !== before.mode) stage.setMode(state.mode, theme.theme);
    if (state.highlightedRegion !== before.highlightedRegion) stage.highlightRegion(state.highlightedRegion);
    const [target, targetBefore] = [targetOf(state), targetOf(before)];
    if (!isSamePlace(target, targetBefore)) markers.setAim(target, arcStart(camera.eye, state), camera.eye);
    if (target?.fraction !== targetBefore?.fraction) markers.setFraction(target?.fraction ?? null);
    if (state.split !== before.split) stage.setSplit(state.split);
    // The service brings what the radius covers: an aim of another one would foresee the wrong segments.
    stage.showsCoarse = state.showsCoarse;
    const isOtherRadius = state.radiusM !== before.radiusM && state.aim?.radiusM !== state.radiusM;
    if (state.aim !== null && (isOtherRadius || state.showsCoarse !== before.showsCoarse)) {
      desk.aim(state.aim.place, state.radiusM);
    }
    if (state.measured !== before.measured) markers.setPath(state.measured);
    // Another tool means another click: an aim that stayed would be landed on by mistake.
    if (state.tool !== before.tool && state.tool !== "land") desk.cancelAim();
    if (state.mode !== before.mode) link.follow(settledRoute);
    if (
      target?.fraction !== targetBefore?.fraction ||
      !isSamePlace(target, targetBefore) ||
      state.picked?.place !== before.picked?.place ||
      state.measured !== before.measured
    ) {
      labels.set(labelsOf(state));
    }
    if (state.outside !== before.outside || state.view !== before.view) sayWhereDetailEnds(notices, state);
    listeners.emit("state", state);
    loop.request();
  });
}

/**
 * Where the arc to an aim begins: at the walker's eye. From above there is nobody to start from but where the last landing
 * was; without one it drops on the place from above.
 */
function arcStart(eye: Vec3, state: ViewerState): Vec3 {
  const target = targetOf(state);
  if (state.view === "walk" || target === null) return eye;
  const [x, y, z] = target.place;
  return state.landed?.place ?? [x, y + target.radiusM * 0.6, z];
}

/** What the ring marks, and how much of it is loaded, 0 to 1; null for an aim. */
interface Target {
  readonly place: Vec3;
  readonly radiusM: number;
  readonly fraction: number | null;
}

/** What the ring stands about: the aim, else the place of a landing that is under way. */
function targetOf({ aim, landing }: ViewerState): Target | null {
  if (aim !== null) return { ...aim, fraction: null };
  if (landing === null) return null;
  const { phase, position: place, radiusM, fraction } = landing;
  const isUnderWay = phase === "planning" || phase === "streaming" || phase === "presentable";
  return isUnderWay ? { place, radiusM, fraction } : null;
}

function isSamePlace(a: Target | null, b: Target | null): boolean {
  if (a === null || b === null) return a === b;
  return a.radiusM === b.radiusM && a.place.every((value, axis) => value === b.place[axis]);
}

function labelsOf(state: ViewerState): readonly Label[] {
  const { picked, measured } = state;
  const target = targetOf(state);
  const labels: Label[] = [];
  if (target !== null) {
    const { fraction } = target;
    const progress = fraction === null ? "" : ` · ${formatPercent(fraction)}`;
    labels.push({ position: target.place, kind: "aim", text: `${formatRadius(target.radiusM)}${progress}` });
  }
  if (picked !== null) labels.push({ position: picked.place, kind: "pick", text: "" });
  for (const position of measured) labels.push({ position, kind: "measure", text: "" });
  for (const [index, leg] of (measurePath(measured)?.legs ?? []).entries()) {
    labels.push({
      position: middle(measured[index]!, measured[index + 1]!),
      kind: "length",
      text: formatMetres(leg.straightM),
    });
  }
  return labels;
}

function sayWhereDetailEnds(notices: Notices, { outside, view }: ViewerState): void {
  if (!outside || view !== "walk") {
    notices.clear("edge");
    return;
  }
  notices.show({
    key: "edge",
    tone: "info",
    title: "Detail ends here",
    text: "Beyond this point only the base is shown. Click the ground ahead to land there.",
    remedies: [],
  });
}

function middle(a: Vec3, b: Vec3): Vec3 {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2];
}
