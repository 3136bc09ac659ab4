/** The parts of an open viewer, for the modules that join them. */

import type { DeviceBudgets } from "../../core/client/index.ts";
import type { SceneFiles, Stream, Vec3 } from "../../core/types.ts";
import type { Stage } from "../../three/stage.ts";
import type { GroundHit } from "../../three/types.ts";
import type { Route } from "../route.ts";
import type { Shell } from "../shell.ts";
import type { CameraDesk, Ray } from "./camera-desk.ts";
import type { ComfortWatch } from "./comfort.ts";
import type { EmbedListeners } from "./embed.ts";
import type { FrameLoop } from "./frame-loop.ts";
import type { Going } from "./going.ts";
import type { HeadsetEntry } from "./headset-entry.ts";
import type { LandingDesk } from "./landing-desk.ts";
import type { Markers } from "./markers.ts";
import type { Notices } from "./notices.ts";
import type { PlaceLink } from "./place-link.ts";
import type { ViewerStore } from "./state.ts";
import type { World } from "./world.ts";

/** What a viewer is made for. */
export interface ViewerOptions {
  readonly shell: Shell;
  readonly sceneUrl: string;
  readonly files: SceneFiles;
  readonly stream: Stream;
  readonly budgets: DeviceBudgets;
  /** What the address says. */
  readonly route: Route;
  /** Leave this viewer and load the scene anew, at the same place. */
  readonly reload: (version?: string) => void;
  /** The scene's files of a version, for one that came while a headset is worn. */
  readonly loadFiles: (version: string) => Promise<SceneFiles>;
}

/** The parts. */
export interface Parts extends ViewerOptions {
  readonly store: ViewerStore;
  readonly world: World;
  readonly stage: Stage;
  readonly camera: CameraDesk;
  readonly comfort: ComfortWatch;
  readonly desk: LandingDesk;
  readonly markers: Markers;
  readonly notices: Notices;
  readonly loop: FrameLoop;
  readonly listeners: EmbedListeners;
  readonly headset: HeadsetEntry;
  readonly link: PlaceLink;
  readonly going: Going;
  /** The ground along a ray, as far as anything is shown. */
  cast(ray: Ray): GroundHit | null;
  /** Where to stand at a place, or near it; the place itself where nobody could. */
  stand(at: Vec3): Vec3;
  /** The highest ground at (x, z). */
  highest(x: number, z: number): number | null;
}
