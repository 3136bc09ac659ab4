/** `@terraport/client/three`: {@link Terrain}, a scene as an object of three.js. */

export { deviceBudgets, deviceClass } from "./device.ts";
export type { Theme } from "./display.ts";
export { isBuried, judgeFooting, newStand, standNear } from "./footing.ts";
export { type Gain, pointSpacingM } from "./gain.ts";
export type { Shading } from "./ground-shading.ts";
export {
  type Place,
  Terrain,
  type TerrainEventMap,
  type TerrainIntersection,
  type TerrainOpenOptions,
  type TerrainOptions,
} from "./terrain.ts";
export type * from "./types.ts";
