/** The profile of a measured path: a drawing, and the files to carry away. */

import { h, setShown, setText } from "../dom.ts";
import { formatMetres } from "../format.ts";
import { icon } from "../icons.ts";
import { type Profile, profileAlong, profileCsv, profileDxf, type ToSurvey } from "../profile.ts";
import { saveFile } from "../save-file.ts";
import type { ViewerState, ViewerStore } from "../viewer/state.ts";

/** What the profile is taken of. */
export interface ProfileOptions {
  readonly store: ViewerStore;
  /** Of the highest ground shown at (x, z); null where there is none. */
  heightAt(x: number, z: number): number | null;
  toSurvey: ToSurvey;
}

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 300;
const HEIGHT = 96;
const MARGIN = 4;

/** Build the section; it follows `measured`, and what is shown, of the store. */
export function createProfileSection({ store, heightAt, toSurvey }: ProfileOptions): HTMLElement {
  let profile: Profile = [];
  const path = document.createElementNS(SVG, "path");
  const drawing = document.createElementNS(SVG, "svg");
  drawing.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  drawing.setAttribute("class", "profile");
  drawing.setAttribute("role", "img");
  drawing.append(path);
  const words = h("p", { class: "faint" });
  const saveButton = (kind: "CSV" | "DXF", type: string, write: (profile: Profile, toSurvey: ToSurvey) => string) =>
    h(
      "button",
      {
        type: "button",
        class: "button",
        "data-action": `save-profile-${kind.toLowerCase()}`,
        on: {
          click: () =>
            saveFile(
              new Blob([write(profile, toSurvey)], { type }),
              `${store.get().manifest.id}-profile.${kind.toLowerCase()}`,
            ),
        },
      },
      icon("report"),
      `Save ${kind}`,
    );
  const element = h(
    "section",
    { id: "profile", "aria-label": "Profile" },
    h("h2", {}, "Profile"),
    drawing as unknown as HTMLElement,
    words,
    h(
      "div",
      { class: "row" },
      saveButton("CSV", "text/csv", profileCsv),
      saveButton("DXF", "image/vnd.dxf", profileDxf),
    ),
  );

  function draw(): void {
    const points = profile.flat();
    const heights = points.map(({ position }) => position[1]);
    const lowM = Math.min(...heights);
    const highM = Math.max(...heights);
    const lengthM = points[points.length - 1]?.distanceM ?? 0;
    // One scale for both axes would draw most ground as a line: heights fill the drawing, and the words say how much.
    const up = (HEIGHT - 2 * MARGIN) / Math.max(highM - lowM, 1e-6);
    const along = (WIDTH - 2 * MARGIN) / Math.max(lengthM, 1e-6);
    const commands = profile.map((piece) =>
      piece
        .map(({ distanceM, position }, index) => {
          const x = MARGIN + distanceM * along;
          const y = HEIGHT - MARGIN - (position[1] - lowM) * up;
          return `${index === 0 ? "M" : "L"}${x.toFixed(1)} ${y.toFixed(1)}`;
        })
        .join(""),
    );
    path.setAttribute("d", commands.join(""));
    const text = `${formatMetres(lengthM)} along, ${formatMetres(highM - lowM)} between lowest and highest, heights drawn ${(up / along).toFixed(1)} times as large. The ground as shown: full detail where you landed, base elsewhere.`;
    drawing.setAttribute("aria-label", text);
    setText(words, text);
  }

  let shown: Partial<ViewerState> = {};
  function show(state: ViewerState): void {
    const isOpen = state.panelOpen && state.tab === "inspect";
    // A thousand rays: only where somebody looks, and where the path or what lies under it has changed.
    if (!isOpen || (state.measured === shown.measured && state.swaps === shown.swaps)) return;
    shown = state;
    profile = profileAlong(state.measured, heightAt);
    setShown(element, profile.length > 0);
    if (profile.length > 0) draw();
  }
  setShown(element, false);
  store.subscribe(show);
  show(store.get());
  return element;
}
