/** Pointing at the ground: the arc, the ring under its end, what is told to the service, and where a release would land. */

import type { Object3D } from "three";
import type { Vec3 } from "../core/types.ts";
import { judgeFooting, newStand } from "../three/footing.ts";
import type { Landings } from "../three/types.ts";
import { ARC_DEFAULTS, castArc, cutShort, newArc, pointsAway, throwArc } from "./arc.ts";
import { isHand, type Pointer } from "./inputs.ts";
import { createRibbon } from "./ribbon.ts";
import { createRing } from "./ring.ts";
import { facingOfStick } from "./snap.ts";
import { BEFORE_MS, clearTrail, newTrail, noteTarget, targetBefore } from "./steady.ts";

/** The service is told of at most ten places a second, and of none that is nearly the last. */
const AIM_EVERY_MS = 100;
const AIM_MOVED_M = 0.25;

export interface Aimed {
  readonly position: Vec3;
  readonly normal: Vec3;
  /** How much the facing turns, radians, counter-clockwise. */
  readonly turnRad: number;
}

export interface Aiming {
  readonly objects: readonly Object3D[];
  /** Casts of the last frame. */
  readonly casts: number;
  begin(): void;
  /** Once a frame while somebody aims. */
  update(pointer: Pointer, eye: Vec3, facingRad: number, nowMs: number): void;
  /** Where letting go now lands; null where one cannot. */
  aimed(pointer: Pointer, nowMs: number): Aimed | null;
  hide(): void;
  dispose(): void;
}

/**
 * An aim at what `landings` shows, hidden. Ribbon and ring are its own, to be added to the scene by the caller and freed by
 * `dispose`.
 *
 * What is drawn in a frame is what a release in that frame would do: arc, footing, ring and trail come from one throw.
 */
export function createAiming(landings: Landings, radiusM: () => number): Aiming {
  const arc = newArc();
  const stand = newStand();
  const trail = newTrail();
  const ribbon = createRibbon(ARC_DEFAULTS.pieces + 1);
  const ring = createRing();
  let casts = 0;
  let turnRad = 0;
  let sentMs = Number.NEGATIVE_INFINITY;
  let sentPosition: Vec3 | null = null;
  // Casts are what an aim costs; the figures show them.
  const counted = {
    cast: (...args: Parameters<Landings["cast"]>) => {
      casts += 1;
      return landings.cast(...args);
    },
    groundAt: (...args: Parameters<Landings["groundAt"]>) => {
      casts += 1;
      return landings.groundAt(...args);
    },
  };
  const sendAim = (position: Vec3, nowMs: number): void => {
    const movedM = sentPosition === null ? Number.POSITIVE_INFINITY : distance(sentPosition, position);
    if (movedM < AIM_MOVED_M || nowMs - sentMs < AIM_EVERY_MS) {
      return;
    }
    sentPosition = position;
    sentMs = nowMs;
    landings.prefetch(position, radiusM());
  };
  return {
    objects: [ribbon.object, ring.object],
    get casts() {
      return casts;
    },
    begin() {
      clearTrail(trail);
      turnRad = 0;
      sentPosition = null;
    },
    update(pointer, eye, facingRad, nowMs) {
      casts = 0;
      turnRad = facingOfStick(pointer.stickX, pointer.stickY, turnRad);
      // (1) Where the arc comes down, and whether one can stand there.
      throwArc(arc, pointer.origin, pointer.direction);
      if (pointsAway(pointer.direction)) {
        cutShort(arc);
      } else {
        castArc(arc, counted);
      }
      judgeFooting(stand, arc.hit, counted);
      const firm = stand.footing === "firm" && arc.hit !== null;
      // (2) The trail, since a pinch moves the hand before it is recognised; and what is seen.
      noteTarget(trail, nowMs, firm ? arc.hit!.position : null);
      ribbon.draw(arc.points, arc.count, eye, firm);
      if (arc.hit === null) {
        ring.hide();
        return;
      }
      ring.lay(arc.hit.position, stand.normal, eye, facingRad + turnRad);
      if (!firm) {
        ring.show("invalid", 0);
        return;
      }
      // (3) The service is told only where a release would land.
      sendAim(arc.hit.position, nowMs);
      ring.show("aim", 1);
    },
    aimed(pointer, nowMs) {
      const position = targetBefore(trail, nowMs, isHand(pointer.source) ? BEFORE_MS : 0);
      return position === null ? null : { position, normal: [...stand.normal], turnRad };
    },
    hide() {
      casts = 0;
      ribbon.hide();
      ring.hide();
    },
    dispose() {
      ribbon.dispose();
      ring.dispose();
    },
  };
}

function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
