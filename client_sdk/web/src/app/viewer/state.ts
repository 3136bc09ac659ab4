/** What the viewer shows, as one value. */

import type { GroupFacts } from "../../core/extras/group-types.ts";
import type { LinkState, PickHit, SceneManifest, Vec3 } from "../../core/types.ts";
import type { Gain } from "../../three/gain.ts";
import type { LandingStatus, ViewMode } from "../../three/types.ts";
import type { ViewKind } from "../route.ts";
import type { Store } from "../store.ts";

/** What a click on the ground does. */
export type Tool = "land" | "pick" | "measure" | "brush";

/** Tabs of the panel, by the names in their element ids. */
export type PanelTab = "landing" | "look" | "inspect" | "places" | "figures";

/** Where the user points and may land. */
export interface Aim {
  readonly place: Vec3;
  readonly radiusM: number;
  /** Payload bytes that came ahead. */
  readonly bytes: number;
}

/** The point that the pick tool was used on last. */
export interface Picked {
  /** As the page itself met the ground. */
  readonly place: Vec3;
  readonly segment: number;
  readonly region: number;
  /** What the service says; null while it is asked. */
  readonly answer: PickHit | "none" | "failed" | null;
}

/** Facts of the newest swap. */
export interface Landed {
  readonly place: Vec3;
  readonly radiusM: number;
  /** Of full detail. */
  readonly effectiveRadiusM: number;
  /** How far the coarser level is shown beyond it; null where none is. */
  readonly coarseRadiusM: number | null;
  readonly segments: number;
  readonly triangles: number;
  readonly bytes: number;
  readonly readyMs: number | null;
  readonly shownMs: number | null;
  readonly degraded: boolean;
  readonly missing: number;
  readonly omittedBy: string | null;
}

/** What the user sees and has chosen, in one value; modules read it and subscribe, instead of asking each other. */
export interface ViewerState {
  readonly manifest: SceneManifest;
  readonly link: LinkState | null;
  readonly view: ViewKind;
  readonly tool: Tool;
  readonly mode: ViewMode;
  readonly highlightedRegion: number | null;
  readonly radiusM: number;
  /** Whether landings show the coarser level around that, where the scene has one. */
  readonly showsCoarse: boolean;
  /** Of the service; null until it said so. */
  readonly maxRadiusM: number | null;
  readonly landing: LandingStatus | null;
  readonly landed: Landed | null;
  readonly aim: Aim | null;
  readonly picked: Picked | null;
  readonly measured: readonly Vec3[];
  /** Whether who lands from above is put on the ground there. */
  readonly bringsCamera: boolean;
  /** What the newest landing made sharper; null without one, or where nothing of the base is hidden. */
  readonly gain: Gain | null;
  /** Where the picture is divided into base and full detail, as a share of its width; null where it is not. */
  readonly split: number | null;
  /** The group that the user goes with; null without one, and then perhaps why. */
  readonly group: GroupFacts | null;
  readonly groupProblem: string | null;
  /** Whether he is taken where the guide asks. */
  readonly follows: boolean;
  readonly panelOpen: boolean;
  readonly tab: PanelTab;
  /** The walker stands beyond the landing's detail. */
  readonly outside: boolean;
  readonly presenting: boolean;
  readonly contextLost: boolean;
  /** Swaps, and changes of what is visible. */
  readonly swaps: number;
  readonly visibleChanges: number;
  /** Changes that no swap made: none, ever (the comfort rule). */
  readonly strayChanges: number;
}

/** Holder of the state; `set` merges, and calls the subscribers at once. */
export type ViewerStore = Store<ViewerState>;
