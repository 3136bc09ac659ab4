/**
 * The teleport arc: the path of a thrown stone, cut into a bounded number of straight pieces and cast against what is shown.
 *
 * A straight ray from the hand reaches ground at a grazing angle, where a degree of the wrist is ten metres of ground; a
 * thrown stone comes down steeply, and a hand raised a little reaches a little further.
 */

import type { Vec3 } from "../core/types.ts";
import type { GroundHit, Landings } from "../three/types.ts";

export interface ArcOptions {
  /** As on earth, so that hands know it; metres per second squared. */
  readonly gravityMS2: number;
  /** How fast it leaves the hand. On level ground it reaches speed squared / gravity. */
  readonly speedMS: number;
  /** How far it may go horizontally. */
  readonly maxRangeM: number;
  /** How far below the hand it may go: from the rim of a pit down to its floor. */
  readonly maxDropM: number;
  /** Straight pieces, each of them one cast a frame. */
  readonly pieces: number;
}

/**
 * 18 m/s: 33 m on level ground, about half of the usual radius of a landing. With 20 pieces of at most 0.25 s, a piece is
 * nowhere more than 8 cm off the true curve; with the four probes of the footing a frame costs at most 24 casts.
 */
export const ARC_DEFAULTS: ArcOptions = { gravityMS2: 9.81, speedMS: 18, maxRangeM: 50, maxDropM: 60, pieces: 20 };

/** An arc in memory of its own, filled anew every frame. */
export interface Arc {
  /** x, y, z of `pieces + 1` points, scene frame. */
  readonly points: Float32Array;
  /** Points in use: up to the first thing that is met. */
  count: number;
  /** What was met at the last point in use. */
  hit: GroundHit | null;
  /** Length along the arc up to there, metres. */
  lengthM: number;
}

/** An empty arc. */
export function newArc(options: ArcOptions = ARC_DEFAULTS): Arc {
  return { points: new Float32Array((options.pieces + 1) * 3), count: 0, hit: null, lengthM: 0 };
}

/** Higher than this nobody means the ground: the hand is raised to call the landing off. Degrees above level. */
export const AWAY_UP_DEG = 60;
/** Pieces of the arc that are drawn then. */
const STUB = 3;

const AWAY_UP = Math.sin((AWAY_UP_DEG * Math.PI) / 180);

/** Whether a direction points away from the ground. */
export function pointsAway(direction: Vec3): boolean {
  return direction[1] > AWAY_UP * Math.hypot(direction[0], direction[1], direction[2]);
}

/** Keep the arc's first bit alone, without a hit. */
export function cutShort(arc: Arc): void {
  arc.count = Math.min(arc.count, STUB + 1);
  arc.hit = null;
}

/** Seconds until the stone has reached the range or the drop; `upMS` and `alongMS` are its first speeds. */
export function flightS(upMS: number, alongMS: number, options: ArcOptions): number {
  const { gravityMS2, maxDropM, maxRangeM } = options;
  const untilDrop = (upMS + Math.sqrt(upMS * upMS + 2 * gravityMS2 * maxDropM)) / gravityMS2;
  return alongMS > 0 ? Math.min(untilDrop, maxRangeM / alongMS) : untilDrop;
}

/** Fill the arc's points for a throw from `origin` along `direction` (any length but 0). Nothing is cast yet. */
export function throwArc(arc: Arc, origin: Vec3, direction: Vec3, options: ArcOptions = ARC_DEFAULTS): void {
  const scale = options.speedMS / Math.hypot(direction[0], direction[1], direction[2]);
  const speedX = direction[0] * scale;
  const speedY = direction[1] * scale;
  const speedZ = direction[2] * scale;
  const step = flightS(speedY, Math.hypot(speedX, speedZ), options) / options.pieces;
  for (let k = 0; k <= options.pieces; k++) {
    const t = k * step;
    arc.points[3 * k] = origin[0] + speedX * t;
    arc.points[3 * k + 1] = origin[1] + speedY * t - 0.5 * options.gravityMS2 * t * t;
    arc.points[3 * k + 2] = origin[2] + speedZ * t;
  }
  arc.count = options.pieces + 1;
  arc.hit = null;
}

// Filled anew by every cast: a frame's loop makes no garbage of its own.
const from: [number, number, number] = [0, 0, 0];
const along: [number, number, number] = [0, 0, 0];

/** Follow the arc's pieces to the first thing that is shown, and cut the arc there. At most one cast a piece. */
export function castArc(arc: Arc, landings: Pick<Landings, "cast">): void {
  const { points } = arc;
  arc.hit = null;
  arc.lengthM = 0;
  const count = arc.count;
  for (let k = 0; k + 1 < count; k++) {
    for (let axis = 0; axis < 3; axis++) {
      from[axis] = points[3 * k + axis]!;
      along[axis] = points[3 * k + 3 + axis]! - from[axis]!;
    }
    const lengthM = Math.hypot(along[0], along[1], along[2]);
    const hit = lengthM > 0 ? landings.cast(from, along, lengthM) : null;
    if (hit !== null) {
      // The last point in use becomes the meeting itself: the ribbon ends on the ground.
      points.set(hit.position, 3 * k + 3);
      arc.count = k + 2;
      arc.hit = hit;
      arc.lengthM += hit.distanceM;
      return;
    }
    arc.lengthM += lengthM;
  }
}
