/** Says over the picture which other scenes are being built, and when they can be opened. */

import type { SceneList } from "../../core/scene/list.ts";
import type { BuildingScene } from "../../core/types.ts";
import type { Notice } from "../failures.ts";
import { buildingStep } from "../format.ts";
import type { Notices } from "./notices.ts";

const KEY = "building";
const PERIOD_MS = 2000;

/** Looks without the scene after its build's end, before it counts as failed: the service may see it a moment later. */
const LOOKS_AFTER_END = 3;

/** The page's list, its messages, and the scene that is shown. */
export interface BuildingWatchOptions {
  readonly sceneId: string;
  readonly notices: Notices;
  /** GET /scenes. */
  list(signal: AbortSignal): Promise<SceneList>;
}

/**
 * Ask once, and again every two seconds while something is built; a service that builds nothing is asked once.
 *
 * One build is told of at a time, the first by id. A list that cannot be had ends it: other messages say that.
 */
export function watchBuilding({ sceneId, notices, list }: BuildingWatchOptions): { dispose(): void } {
  const abort = new AbortController();
  let awaited: BuildingScene | null = null;
  let looksLeft = 0;
  let dismissed = false;
  let timer: number | undefined;

  async function look(): Promise<void> {
    try {
      const { scenes, building } = await list(abort.signal);
      if (abort.signal.aborted) return;
      const other = building.find(({ id }) => id !== sceneId);
      if (other !== undefined) {
        if (other.id !== awaited?.id) dismissed = false;
        else if (!isShown()) dismissed = true;
        awaited = other;
        looksLeft = LOOKS_AFTER_END;
        if (!dismissed) notices.show(progressNotice(other));
      } else if (awaited !== null) {
        const ended = awaited;
        if (scenes.some(({ id }) => id === ended.id)) {
          notices.show(readyNotice(ended));
          awaited = null;
        } else if (--looksLeft === 0) {
          notices.clear(KEY);
          awaited = null;
        }
      }
    } catch {
      if (!abort.signal.aborted) notices.clear(KEY);
      return;
    }
    if (awaited !== null) timer = window.setTimeout(() => void look(), PERIOD_MS);
  }

  function isShown(): boolean {
    return notices.current.some(({ key }) => key === KEY);
  }

  void look();
  return {
    dispose() {
      abort.abort();
      window.clearTimeout(timer);
    },
  };
}

function progressNotice(scene: BuildingScene): Notice {
  return {
    key: KEY,
    tone: "info",
    title: `${scene.name} is being built`,
    text: `${buildingStep(scene)}. Look around here until it is ready.`,
    remedies: ["dismiss"],
  };
}

function readyNotice({ name }: BuildingScene): Notice {
  return {
    key: KEY,
    tone: "info",
    title: `${name} is ready`,
    text: "Open it from the list of scenes.",
    remedies: ["scenes", "dismiss"],
  };
}
