/** The panel of a viewer: its tabs, and what they ask for. */

import type { SceneFiles } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import type { Bookmark } from "../bookmarks.ts";
import { h, setText } from "../dom.ts";
import { createFiguresTab } from "../panel/figures-tab.ts";
import { createGroupSection, type GroupActions } from "../panel/group-section.ts";
import { createInspectTab } from "../panel/inspect-tab.ts";
import { createLandingTab } from "../panel/landing-tab.ts";
import { createLookTab } from "../panel/look-tab.ts";
import { createPanel } from "../panel/panel.ts";
import { createPlacesTab } from "../panel/places-tab.ts";
import { regionsToVisit } from "../region-places.ts";
import { formatRoute, type Route } from "../route.ts";
import type { Shell } from "../shell.ts";
import type { ViewerStore } from "./state.ts";

/** What the tabs show, and what their buttons do. */
export interface ViewerPanelOptions {
  readonly store: ViewerStore;
  readonly stage: Terrain;
  readonly files: SceneFiles;
  readonly shell: Shell;
  readonly frames: readonly number[];
  copy(text: string, subject: string): void;
  landAim(): void;
  cancelAim(): void;
  aimAtCentre(): void;
  undoPoint(): void;
  /** Of the highest ground shown at (x, z); null where there is none. */
  heightAt(x: number, z: number): number | null;
  savePicture(): void;
  readonly group: GroupActions;
  go(hash: string): void;
  /** The address of what is shown. */
  routeNow(): Route;
  diagnostics(): Promise<object>;
}

/** The tabs beside the picture, and the words that its buttons answer with. */
export interface ViewerPanel {
  readonly element: HTMLElement;
  /** Read the figures anew, where they are shown. */
  refresh(): void;
  /** Keep what is shown as a place. */
  keep(): void;
  keptPlaces(): readonly Bookmark[];
  /** A word for some seconds: what a button has done. */
  flash(text: string): void;
  /** For a browser that does not let the page copy: the text to be copied by hand. */
  showText(text: string): void;
}

const FLASH_MS = 2500;
/** Named regions that are listed. */
const MAX_NAMED = 500;

/** Build the tabs over the viewer's store; they follow it, but for the figures, which wait for `refresh`. */
export function createViewerPanel(options: ViewerPanelOptions): ViewerPanel {
  const { store, stage, files, shell } = options;
  const { manifest, regions } = files;

  const figures = createFiguresTab(store, {
    stats: () => stage.stats(),
    frames: options.frames,
    copyDiagnostics() {
      void options.diagnostics().then((report) => options.copy(JSON.stringify(report, null, 2), "Diagnostics"));
    },
  });
  const placesTab = createPlacesTab({
    storage: shell.storage,
    scene: manifest.id,
    together: createGroupSection(store, options.group),
    regions: regionsToVisit(manifest.id, regions, MAX_NAMED),
    currentHash: () => (store.get().landed === null ? null : formatRoute(options.routeNow())),
    go: options.go,
    announce(text) {
      shell.announcer.announce(text);
      flash(text);
    },
  });
  const panel = createPanel(store, {
    landing: createLandingTab(store, {
      land: options.landAim,
      cancel: options.cancelAim,
      copyLink: () => options.copy(new URL(formatRoute(options.routeNow()), window.location.href).href, "Link"),
      savePicture: options.savePicture,
      aimAtCentre: options.aimAtCentre,
    }),
    look: createLookTab(store, { regions, regionColour: (id) => stage.regionColour(id) }),
    inspect: createInspectTab(store, {
      regions,
      unions: files.unions ?? [],
      copy: options.copy,
      undoPoint: options.undoPoint,
      heightAt: options.heightAt,
    }),
    places: placesTab.element,
    figures: figures.element,
  });

  const toast = h("div", { class: "toast", "aria-hidden": "true", hidden: true });
  let timer = 0;
  function flash(text: string): void {
    window.clearTimeout(timer);
    setText(toast, text);
    toast.hidden = false;
    timer = window.setTimeout(() => {
      toast.hidden = true;
    }, FLASH_MS);
  }

  // A modal dialog, so that the selection for Ctrl+C is where the focus is.
  const text = h("textarea", { readonly: true, rows: 8, "aria-label": "Text to copy" });
  const copyDialog = h(
    "dialog",
    { id: "copy-dialog", class: "dialog", "aria-labelledby": "copy-title" },
    h(
      "div",
      { class: "stack" },
      h("h2", { id: "copy-title" }, "Copy this text"),
      h("p", { class: "faint" }, "The browser does not let the page copy by itself here."),
      text,
      h(
        "div",
        { class: "dialog-actions" },
        h("button", { type: "button", class: "button primary", on: { click: () => copyDialog.close() } }, "Done"),
      ),
    ),
  );

  return {
    element: h("div", { class: "panel-place" }, panel, copyDialog, toast),
    refresh() {
      const { panelOpen, tab } = store.get();
      if (panelOpen && tab === "figures") figures.refresh();
    },
    keep() {
      placesTab.keep();
    },
    keptPlaces: placesTab.list,
    flash,
    showText(value) {
      text.value = value;
      copyDialog.showModal();
      text.select();
    },
  };
}
