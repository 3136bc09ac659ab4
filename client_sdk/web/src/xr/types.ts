/** What the page gives the headset, and what it gets back. */

import type { Group, Object3D, PerspectiveCamera, WebGLRenderer } from "three";
import type { StreamEvent, Vec3 } from "../core/types.ts";
import type { Landings, MiniaturePose, ViewMode } from "../three/types.ts";
import type { TimeSummary } from "./frames.ts";
import type { TeleportPhase } from "./teleport.ts";

/** A place with the way somebody looks there: a compass azimuth in degrees, 0 north (-Z), 90 east (+X). */
export interface Standpoint {
  readonly place: Vec3;
  readonly yawDeg: number;
}

export interface HeadsetBookmark {
  readonly label: string;
  readonly place: Vec3;
  /** Null: the user keeps looking as they do. */
  readonly yawDeg: number | null;
  /** Null: the present radius. */
  readonly radiusM: number | null;
}

/** What the menu in the headset can change. All of it is asked again whenever the menu is drawn. */
export interface HeadsetMenu {
  readonly modes: () => readonly { readonly label: string; readonly mode: ViewMode }[];
  /** Index of the present mode in `modes`. */
  readonly modeIndex: () => number;
  readonly setMode: (mode: ViewMode) => void;
  readonly setRadiusM: (radiusM: number) => void;
  readonly bookmarks: () => readonly HeadsetBookmark[];
}

/** What a trigger does on the ground. */
export type HeadsetTool = "land" | "pick" | "measure";

/** What stands in the world of a pick or a measurement: its label at the last of its points. Another object once it differs. */
export interface HeadsetMark {
  /** Scene frame, metres. */
  readonly points: readonly Vec3[];
  /** The first is its title; at most nine are shown. */
  readonly lines: readonly string[];
}

/** The page's tools for the ground. Asked in every frame: what has not changed is the same object. */
export interface HeadsetTools {
  readonly tool: () => HeadsetTool;
  readonly setTool: (tool: HeadsetTool) => void;
  /** Use the tool on the ground along a ray. */
  readonly use: (origin: Vec3, direction: Vec3) => void;
  /** Take back what was measured and picked. */
  readonly clear: () => void;
  readonly picked: () => HeadsetMark | null;
  readonly measured: () => HeadsetMark | null;
}

export interface HeadsetOptions {
  readonly renderer: WebGLRenderer;
  /** What is rendered; the arc, ring, panels and veil hang in it while the session lasts. Not moved, turned or scaled. */
  readonly scene: Object3D;
  /** Carries the play space: the camera's parent, child of the scene. */
  readonly rig: Group;
  readonly camera: PerspectiveCamera;
  readonly landings: Landings;
  readonly radiusM: () => number;
  /** Where the user stands at first. Default: under the page's camera, looking as it does. */
  readonly start?: () => Standpoint | null;
  /** The user stands on new ground: the swap and the move have just happened. */
  readonly landed?: (standpoint: Standpoint) => void;
  /** The session is over and the page has its camera back; `last` is where the user stood and looked. */
  readonly ended?: (last: Standpoint | null) => void;
  /** Milliseconds a frame that uploads may take; null: back to the page's own. */
  readonly setUploadBudgetMs?: (budgetMs: number | null) => void;
  /** Without it the menu has only the turn angle and the way out. */
  readonly menu?: HeadsetMenu;
  /** Without them a trigger lands, and nothing else. */
  readonly tools?: HeadsetTools;
  /** Draws the scene as a model; without it the menu offers no overview. */
  readonly setMiniature?: (pose: MiniaturePose | null) => void;
}

export type Tone = "info" | "warning";

/** Of the last 240 frames. */
export interface HeadsetStats {
  readonly frames: number;
  readonly frameRateHz: number | null;
  /** Between frames. */
  readonly interval: TimeSummary;
  /** Main thread, from `frame` to `drawn`. */
  readonly work: TimeSummary;
  /** The part of it that is the headset's own: `frame`. */
  readonly own: TimeSummary;
  readonly phase: TeleportPhase;
  /** Casts of the last frame. */
  readonly casts: number;
}

/**
 * A session in the headset. While it is active only it moves the rig, lands and swaps.
 *
 * The page's animation loop calls `frame` first, then updates its scene and renders, then calls `drawn`.
 */
export interface HeadsetSession {
  readonly active: boolean;
  /** The ground under the head and the way it looks, now; null before the first pose. */
  readonly standpoint: Standpoint | null;
  readonly frame: (timeMs: number, frame: XRFrame | undefined) => void;
  readonly drawn: () => void;
  /** Every event of the stream. */
  readonly handle: (event: StreamEvent) => void;
  /** Show a line on the board in the world. */
  readonly message: (text: string, tone: Tone) => void;
  readonly stats: () => HeadsetStats;
  /** Resolves when the page has its camera back. */
  readonly end: () => Promise<void>;
}
