/**
 * `@terraport/client/core`: scenes, streams and decoded segments, for any renderer. No three.js, no DOM.
 *
 * A landing is asked of a {@link Stream}. When its event `ready` came, an engine decodes the segments that it does not draw yet by
 * `stream.mesh(key, manifest.attributes)`, and then shows exactly those, without the faces of the base in `hidden`, in one frame.
 */

export { budgetsFor, type DeviceBudgets, type DeviceClass } from "./budgets.ts";
export { type DirectParts, openDirectStream } from "./client/direct-stream.ts";
export { type LoadSceneOptions, loadSceneInWorker } from "./client/load-scene.ts";
export { openStream } from "./client/open-stream.ts";
export type * from "./extras/group-types.ts";
export { fetchTaught, listStrokes, paintStroke, type StrokeList, takeBackStroke } from "./extras/strokes.ts";
export { type GpuShares, sharesOf } from "./gpu-budget.ts";
export { StreamError } from "./scene/errors.ts";
export { type HttpOptions, listScenes, type SceneList } from "./scene/load.ts";
export { coarserPieces } from "./scene/regions.ts";
export { parseSceneUrl, sceneUrlOf } from "./scene/urls.ts";
export type * from "./types.ts";
