/** What keys, buttons and messages ask for. */

import type { Stream } from "../../core/types.ts";
import type { HeadsetOptions } from "../../xr/types.ts";
import type { Remedy } from "../failures.ts";
import type { Shell } from "../shell.ts";
import type { Brush } from "./brush.ts";
import type { CameraDesk } from "./camera-desk.ts";
import { SPLIT_AT_START } from "./compare.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { Going } from "./going.ts";
import type { GroundTools } from "./ground-tools.ts";
import type { HeadsetEntry } from "./headset-entry.ts";
import type { KeyAction } from "./keys.ts";
import type { LandingDesk } from "./landing-desk.ts";
import type { Markers } from "./markers.ts";
import type { Notices } from "./notices.ts";
import type { Tool, ViewerStore } from "./state.ts";
import { renewToken } from "./stream-watch.ts";
import type { ViewerPanel } from "./viewer-panel.ts";

/** Modules that the actions drive; those made after them are functions, looked up when an action runs. */
export interface ActionOptions {
  readonly store: ViewerStore;
  readonly stream: Stream;
  readonly shell: Shell;
  readonly camera: CameraDesk;
  readonly desk: LandingDesk;
  readonly markers: Markers;
  readonly notices: Notices;
  readonly loop: FrameLoop;
  readonly headset: HeadsetEntry;
  readonly going: Going;
  readonly tools: GroundTools;
  /** What is drawn on. */
  readonly canvas: HTMLElement;
  /** What the headset is given of the page, as it is now. */
  readonly headsetOptions: () => HeadsetOptions;
  /** Load the scene anew. */
  readonly reload: () => void;
  readonly panel: () => ViewerPanel;
  /** Null where the service lets nobody paint. */
  readonly brush: () => Brush | null;
  readonly openHelp: () => void;
  /** The user works with keys: the middle of the picture is marked. */
  readonly usesKeys: () => void;
}

/** Every key, button and remedy of the viewer comes through here. */
export interface Actions {
  act(action: KeyAction): void;
  applyRemedy(remedy: Remedy, noticeKey: string): void;
  copy(text: string, subject: string): Promise<void>;
  /** Straight from the click. */
  enterHeadset(): Promise<void>;
}

/** Bind the actions to the modules; nothing is done yet. */
export function createActions(options: ActionOptions): Actions {
  const { store, stream, shell, camera, desk, markers, notices, loop, headset } = options;
  const { going, tools, canvas, panel, openHelp, usesKeys } = options;

  function useToolAtCentre(): void {
    usesKeys();
    tools.tap(canvas.clientWidth / 2, canvas.clientHeight / 2);
  }

  return {
    act(action) {
      const { aim, tool, panelOpen, split } = store.get();
      switch (action) {
        case "aim":
          usesKeys();
          tools.aimAt(canvas.clientWidth / 2, canvas.clientHeight / 2);
          break;
        case "land":
          if (tool === "land" && aim !== null) going.landAim();
          else useToolAtCentre();
          break;
        case "cancel":
          if (aim !== null) desk.cancelAim();
          else if (split !== null) store.set({ split: null });
          else if (tool !== "land") store.set({ tool: "land" });
          break;
        case "home":
          camera.home();
          going.moved();
          break;
        case "view":
          going.setView(camera.view === "orbit" ? "walk" : "orbit");
          break;
        case "undo":
          if (tool === "brush") options.brush()?.undo();
          else tools.undoPoint();
          break;
        case "tool-brush":
          if (options.brush() !== null) store.set({ tool: "brush" });
          break;
        case "panel":
          store.set({ panelOpen: !panelOpen });
          break;
        case "keep":
          panel().keep();
          break;
        case "compare":
          store.set({ split: split === null ? SPLIT_AT_START : null });
          break;
        case "help":
          openHelp();
          break;
        default:
          store.set({ tool: action.slice("tool-".length) as Tool });
      }
    },
    applyRemedy(remedy, noticeKey) {
      if (remedy === "reconnect") {
        // The message goes when there is a link again.
        stream.reconnect();
        return;
      }
      // The others are done with the click, and their message with them; a token's goes when there is a link again.
      if (remedy === "token") void renewToken(options, true);
      else if (remedy === "scenes") window.location.assign("#list");
      else if (remedy === "reload-page") window.location.reload();
      else if (remedy === "reload-scene") options.reload();
      else if (remedy === "smaller-radius") {
        const { maxRadiusM } = store.get();
        if (maxRadiusM !== null) {
          store.set({ radiusM: maxRadiusM });
          going.landAgain(maxRadiusM);
        }
      }
      if (remedy !== "token") notices.clear(noticeKey);
    },
    async copy(text, subject) {
      try {
        await navigator.clipboard.writeText(text);
        shell.announcer.announce(`${subject} copied`);
        panel().flash(`${subject} copied`);
      } catch {
        panel().showText(text);
      }
    },
    async enterHeadset() {
      try {
        // In the task of the click, or the browser refuses. From `presenting` on the session moves rig and camera.
        await headset.enter(options.headsetOptions());
        if (headset.session === null) return;
        // Who puts it on lands first; a tool of the page is chosen again in the headset's own menu.
        store.set({ presenting: true, aim: null, tool: "land" });
        markers.setVisible(false);
        loop.request();
      } catch (error) {
        notices.show({
          key: "headset",
          tone: "warning",
          title: "The headset could not be entered",
          text: error instanceof Error ? error.message : "The browser refused.",
          remedies: ["dismiss"],
        });
      }
    },
  };
}
