/** What a viewer is made for. */

import type { PerspectiveCamera } from "three";
import type { DeviceBudgets } from "../../core/index.ts";
import type { SceneFiles, Stream } from "../../core/types.ts";
import type { Terrain } from "../../three/index.ts";
import type { Route } from "../route.ts";
import type { Shell } from "../shell.ts";

/** Given by the page of a scene. */
export interface ViewerOptions {
  readonly shell: Shell;
  readonly sceneUrl: string;
  readonly files: SceneFiles;
  readonly stream: Stream;
  readonly budgets: DeviceBudgets;
  /** Place, view and mode to open with, as read from the address. */
  readonly route: Route;
  /** Leave this viewer and load the scene anew, at the same place. */
  readonly reload: (version?: string) => void;
  /** The scene's files of a version, for one that came while a headset is worn. */
  readonly loadFiles: (version: string) => Promise<SceneFiles>;
  /** Whether a newcomer is told how to look and land; in a frame of another page that is the page's affair. */
  readonly guides?: boolean;
  /** Called in every frame between its uploads and its picture: whoever studies the viewer looks on, or takes part, here. */
  readonly eachFrame?: (frame: DrawnFrame) => void;
}

/** A frame that is about to be drawn. */
export interface DrawnFrame {
  readonly stage: Terrain;
  /** The eye; in a headset that of both eyes together. */
  readonly camera: PerspectiveCamera;
  /** Height of the picture, pixels of the device. */
  readonly heightPx: number;
}
