/** What the stream tells, put where the user sees it. */

import type { StreamEvent } from "../../core/types.ts";
import type { Stage } from "../../three/stage.ts";
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
interface Memory {
  everOpen: boolean;
}

/** Whom an event of the stream reaches. */
export interface StreamListeners extends Pick<ViewerOptions, "stream" | "loadFiles" | "reload"> {
  readonly store: ViewerStore;
  readonly stage: Stage;
  readonly desk: LandingDesk;
  readonly headset: HeadsetEntry;
  readonly comfort: ComfortWatch;
  readonly notices: Notices;
  readonly listeners: EmbedListeners;
  readonly loop: FrameLoop;
  readonly shell: Shell;
}

/** Make the listener of a stream. */
export function watchStream(hearers: StreamListeners): (event: StreamEvent) => void {
  const memory: Memory = { everOpen: false };
  return (event) => {
    const neededBefore = hearers.stage.neededVersion;
    hearers.stage.handle(event);
    const { neededVersion } = hearers.stage;
    if (neededVersion !== null && neededVersion !== neededBefore) void takeVersion(hearers, neededVersion);
    hearers.desk.handle(event);
    hearers.headset.handle(event);
    showEvent(hearers, memory, event);
    hearers.listeners.emit("stream", event);
    hearers.loop.request();
  };
}

function showEvent(hearers: StreamListeners, memory: Memory, event: StreamEvent): void {
  const { store, notices, shell } = hearers;
  switch (event.type) {
    case "link": {
      const before = store.get().link;
      store.set({ link: event.link });
      const notice = linkNotice(event.link, memory.everOpen, performance.now());
      if (notice === null) notices.clear("link");
      else notices.show(notice);
      if (event.link.state === "open") {
        if (memory.everOpen && before?.state !== "open") shell.announcer.say("Connected again");
        memory.everOpen = true;
      }
      if (event.link.state === "closed" && event.link.code === "unauthorised")
        void renewToken(hearers, memory.everOpen);
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
  everOpen: boolean,
): Promise<void> {
  const reason = everOpen ? "expired" : shell.token.token === undefined ? "missing" : "refused";
  const given = await shell.token.ask(reason);
  if (given !== null) stream.reconnect(given);
}

/** The session's scene is another version than the one that is shown (wire protocol, 5.4). */
async function takeVersion(hearers: StreamListeners, version: string): Promise<void> {
  const { headset, loadFiles, stage, comfort, reload, notices } = hearers;
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
