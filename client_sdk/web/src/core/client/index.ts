/**
 * Streams and scenes for a page: everything that talks to the server or decodes does so in workers.
 */

export type { DeviceBudgets, DeviceClass } from "../budgets.ts";
export { budgetsFor } from "../budgets.ts";
export { sharedNowMs } from "./clock.ts";
export { type DirectParts, openDirectStream } from "./direct-stream.ts";
export { type LoadSceneOptions, loadSceneInWorker } from "./load-scene.ts";
export { openStream } from "./open-stream.ts";
