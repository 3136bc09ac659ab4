/** What a viewer is made for. */

import type { DeviceBudgets } from "../../core/index.ts";
import type { SceneFiles, Stream } from "../../core/types.ts";
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
}
