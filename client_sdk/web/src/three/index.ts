/**
 * `@terraport/client/three`: a scene drawn by three.js, in an application of one's own.
 *
 * {@link Stage} is an object to add, a handler of the stream's events, and two calls a frame (`update`, and `swap` when its
 * status is presentable).
 */

export { isBuried, judgeFooting, newStand, standNear } from "./footing.ts";
export { type Gain, pointSpacingM } from "./gain.ts";
export type { Shading } from "./ground-shading.ts";
export { Stage, type StageOptions, type Theme } from "./stage.ts";
export type * from "./types.ts";
