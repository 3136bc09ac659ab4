/** What the stream tells, put where the user sees it. */

import type { StreamEvent } from "../../core/types.ts";
import type { Terrain } from "../../three/terrain.ts";
import { linkNotice, refusalNotice } from "../failures.ts";
import type { Shell } from "../shell.ts";
import type { ComfortWatch } from "./comfort.ts";
import type { EmbedListeners } from "./embed.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { HeadsetEntry } from "./headset-entry.ts";
import type { LandingDesk } from "./landing-desk.ts";
import type { Notices } from "./notices.ts";
import type { ViewerStore } from "./state.ts";
import type { ViewerOptions } from "./viewer-options.ts";

/** The first link that opens, or the last one that closed for good: decides which words are used. */
interface LinkHistory {
  wasOpen: boolean;
}

/** Whom an event of the stream reaches. */
export interface StreamListeners extends Pick<ViewerOptions, "stream" | "loadFiles" | "reload"> {
  readonly store: ViewerStore;
  readonly stage: Terrain;
  readonly desk: LandingDesk;
  readonly headset: HeadsetEntry;
  readonly comfort: ComfortWatch;
  readonly notices: Notices;
  readonly listeners: EmbedListeners;
  readonly loop: FrameLoop;
  readonly shell: Shell;
}

/**
 * Listener for `Stream.onEvent`. The stage takes an event before anybody else: what the others read of it is then as new as
 * the event.
 */
export function watchStream(modules: StreamListeners): (event: StreamEvent) => void {
  const history: LinkHistory = { wasOpen: false };
  return (event) => {
    // Asked for once for each version that the session turns to, not for each event until its files are here.
    const neededBefore = modules.stage.neededVersion;
    modules.stage.handle(event);
    const { neededVersion } = modules.stage;
    if (neededVersion !== null && neededVersion !== neededBefore) void takeVersion(modules, neededVersion);
    modules.desk.handle(event);
    modules.headset.handle(event);
    showEvent(modules, history, event);
    modules.listeners.emit("stream", event);
    modules.loop.request();
  };
}

function showEvent(modules: StreamListeners, history: LinkHistory, event: StreamEvent): void {
  const { store, notices, shell } = modules;
  switch (event.type) {
    case "link": {
      const previousLink = store.get().link;
      store.set({ link: event.link });
      const notice = linkNotice(event.link, history.wasOpen, performance.now());
      if (notice === null) notices.clear("link");
      else notices.show(notice);
      if (event.link.state === "open") {
        if (history.wasOpen && previousLink?.state !== "open") shell.announcer.announce("Connected again");
        history.wasOpen = true;
      }
      if (event.link.state === "closed" && event.link.code === "unauthorised")
        void renewToken(modules, history.wasOpen);
      break;
    }
    case "opened":
      store.set({ maxRadiusM: event.maxRadiusM, radiusM: Math.min(store.get().radiusM, event.maxRadiusM) });
      notices.clear("draining");
      break;
    case "refused":
      // A refused aim has no words: the landing there will be refused too, and then it says why.
      if (event.landing !== null) {
        notices.show(refusalNotice(event.code, event.message, store.get().maxRadiusM));
      }
      break;
    case "notice":
      if (event.kind === "scene_published") {
        notices.show({
          key: "version",
          tone: "info",
          title: "A new version of this scene is there",
          text: "What you see stays as it is. Load the new one when it suits you; you come back to this place.",
          remedies: ["reload-scene", "dismiss"],
        });
      } else if (event.kind === "draining") {
        notices.show({
          key: "draining",
          tone: "info",
          title: "The server is about to restart",
          text: "The page reconnects by itself. What is shown stays.",
          remedies: ["dismiss"],
        });
      }
      break;
    default:
      break;
  }
}

/** Ask for another token, and go on where the link broke. */
export async function renewToken(
  { shell, stream }: Pick<StreamListeners, "shell" | "stream">,
  wasOpen: boolean,
): Promise<void> {
  const reason = wasOpen ? "expired" : shell.token.token === undefined ? "missing" : "refused";
  const newToken = await shell.token.ask(reason);
  if (newToken !== null) stream.reconnect(newToken);
}

/** The session's scene is another version than the one that is shown. */
async function takeVersion(modules: StreamListeners, version: string): Promise<void> {
  const { headset, loadFiles, stage, comfort, reload, notices } = modules;
  if (headset.session === null) {
    reload(version);
    return;
  }
  // Whoever wears a headset is not thrown out of it: ground and cover change under him, the panel follows later.
  try {
    stage.replaceFiles(await loadFiles(version));
    comfort.restart();
  } catch {
    notices.show({
      key: "version",
      tone: "warning",
      title: "A new version of this scene is there",
      text: "It could not be loaded. What you see stays.",
      remedies: ["reload-scene", "dismiss"],
    });
  }
}
