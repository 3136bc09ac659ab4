/** What somebody who is asked for help needs to know, as JSON. Holds no token, and no address but the page's own. */

import type { WebGLRenderer } from "three";
import { CLIENT } from "../../core/client/version.ts";
import type { TerrainStats, VisibleDigest } from "../../three/types.ts";
import type { Notice } from "../failures.ts";
import { summariseFrames } from "../frame-times.ts";
import type { ViewerState } from "./state.ts";

/** Where it is read. */
export interface DiagnosticSources {
  readonly renderer: WebGLRenderer;
  readonly state: ViewerState;
  readonly stats: TerrainStats;
  readonly visible: readonly number[];
  readonly visibleDigest: VisibleDigest;
  readonly frameTimes: readonly number[];
  readonly notices: readonly Notice[];
}

/** Read it. */
export function readDiagnostics(sources: DiagnosticSources): object {
  const { renderer, state, stats } = sources;
  const gl = renderer.getContext();
  const debug = gl.getExtension("WEBGL_debug_renderer_info");
  const { memory, render, programs } = renderer.info;
  return {
    client: CLIENT,
    at: new Date().toISOString(),
    browser: navigator.userAgent,
    gpu: {
      renderer: gl.getParameter(debug?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER),
      version: gl.getParameter(gl.VERSION),
      maxTextureSize: gl.getParameter(gl.MAX_TEXTURE_SIZE),
      pixelRatio: renderer.getPixelRatio(),
      size: [gl.drawingBufferWidth, gl.drawingBufferHeight],
    },
    scene: { id: state.manifest.id, version: state.manifest.version, segments: state.manifest.segmentCount },
    link: state.link,
    view: state.view,
    mode: state.mode,
    landing: state.landing,
    landed: state.landed,
    comfort: { landings: state.swaps, changes: state.visibleChanges },
    visible: sources.visible,
    visibleDigest: sources.visibleDigest,
    stats,
    three: {
      geometries: memory.geometries,
      textures: memory.textures,
      programs: programs?.length,
      calls: render.calls,
    },
    frames: summariseFrames(sources.frameTimes),
    notices: sources.notices.map(({ key, title }) => ({ key, title })),
  };
}
