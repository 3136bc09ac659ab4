/** What the stream tells, put where the user sees it. */

import type { StreamEvent } from "../../core/types.ts";
import { linkNotice, refusalNotice } from "../failures.ts";
import type { Parts } from "./parts.ts";

/** The first link that opens, or the last one that closed for good: decides which words are used. */
interface Memory {
  everOpen: boolean;
}

/** Make the listener of a stream. */
export function watchStream(parts: Parts): (event: StreamEvent) => void {
  const memory: Memory = { everOpen: false };
  return (event) => {
    const neededBefore = parts.stage.neededVersion;
    parts.stage.handle(event);
    const { neededVersion } = parts.stage;
    if (neededVersion !== null && neededVersion !== neededBefore) void takeVersion(parts, neededVersion);
    parts.desk.handle(event);
    parts.headset.handle(event);
    tell(parts, memory, event);
    parts.listeners.emit("stream", event);
    parts.loop.request();
  };
}

function tell(parts: Parts, memory: Memory, event: StreamEvent): void {
  const { store, notices, shell } = parts;
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
      if (event.link.state === "closed" && event.link.code === "unauthorised") void renewToken(parts, memory.everOpen);
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
export async function renewToken({ shell, stream }: Parts, everOpen: boolean): Promise<void> {
  const reason = everOpen ? "expired" : shell.token.token === undefined ? "missing" : "refused";
  const given = await shell.token.ask(reason);
  if (given !== null) stream.reconnect(given);
}

/** The session's scene is another version than the one that is shown (wire protocol, 5.4). */
async function takeVersion(parts: Parts, version: string): Promise<void> {
  const { headset, loadFiles, stage, comfort, reload, notices } = parts;
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
