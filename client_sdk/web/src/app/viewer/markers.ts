/**
 * What is drawn on the ground: the arc and ring of an aim, the edge of the landing, the path of a measurement.
 *
 * Every line is drawn twice: faint through the ground, so that a ring behind a bank is not lost, and full where it is seen.
 */

import { Group } from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import type { Vec3 } from "../../core/types.ts";
import { arcPoints, type Drape, drapeCircle, type Heights, levelCircle } from "../arc.ts";

/** Lines over the ground. Owns their geometries and materials; `dispose` frees them. */
export interface Markers {
  readonly object: Group;
  /** Null takes the aim away. The arc starts at `start`, a little below it. */
  setAim(aim: { readonly place: Vec3; readonly radiusM: number } | null, start: Vec3, eye: Vec3): void;
  /** Part of the ring that is filled. */
  setFraction(fraction: number | null): void;
  /** Edge of the landing's detail; null takes it away. */
  setEdge(centre: Vec3 | null, radiusM: number): void;
  /** Once per frame: rings are laid on the ground a few points at a time. True while there is more to lay. */
  step(groundY: Heights): boolean;
  setPath(points: readonly Vec3[]): void;
  /** Headsets draw their own. */
  setVisible(visible: boolean): void;
  resize(width: number, height: number): void;
  dispose(): void;
}

const CIRCLE_POINTS = 144;
/** Of one frame, for asking how high the ground is: a tenth of a millisecond each on a slow machine, or a hundredth. */
const DRAPE_MS = 4;
const POINTS_AT_ONCE = 6;
const ARC_POINTS = 48;
/** Above the ground by a part of the radius: what is far away is seen at a slant, and needs more. */
const LIFT = 0.006;
const MIN_LIFT_M = 0.12;

/** Of an edge so much must lie on the ground, or it is not drawn. */
const MIN_EDGE_PART = 0.4;

const AIM = 0xffb02e;
const EDGE = 0xffffff;
const PATH = 0xe0218a;
const CASING = 0x10181c;

/** Make them, empty. */
export function createMarkers(): Markers {
  const object = new Group();
  const lines: MarkerLine[] = [];
  const make = (colour: number, width: number, opacity: number) => {
    const line = markerLine(colour, width, opacity);
    lines.push(line);
    object.add(line.object);
    return line;
  };
  const aimCasing = make(CASING, 7, 0.45);
  const aimTrack = make(AIM, 3, 0.4);
  const aimFill = make(AIM, 5, 1);
  const aimDot = make(AIM, 4, 1);
  const arc = make(AIM, 3, 0.95);
  const edgeCasing = make(CASING, 5, 0.3);
  const edge = make(EDGE, 2, 0.75);
  const pathCasing = make(0xffffff, 6, 0.85);
  const path = make(PATH, 3, 1);
  const rings = [aimCasing, aimTrack, aimFill];
  let aimDrape: Drape | null = null;
  let nextAim: Drape | null = null;
  let edgeDrape: Drape | null = null;

  return {
    object,
    setAim(aim, start, eye) {
      if (aim === null) {
        for (const line of [...rings, aimDot, arc]) line.set(null);
        aimDrape = null;
        nextAim = null;
        return;
      }
      const { place: centre, radiusM } = aim;
      const drape = drapeCircle(centre, radiusM, CIRCLE_POINTS, liftOf(radiusM));
      // A ring that is half laid is laid first: under a moving finger there would never be one.
      if (aimDrape === null) aimDrape = drape;
      else nextAim = drape;
      const distanceM = Math.hypot(centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]);
      // About as large on the screen from anywhere.
      aimDot.set(levelCircle(centre, Math.max(0.25, distanceM * 0.012), 32, MIN_LIFT_M));
      arc.set(arcPoints(start, centre, ARC_POINTS));
    },
    setFraction(fraction) {
      aimFill.setShare(fraction ?? 0);
    },
    setEdge(centre, radiusM) {
      edgeCasing.set(null);
      edge.set(null);
      edgeDrape = centre === null ? null : drapeCircle(centre, radiusM, CIRCLE_POINTS, liftOf(radiusM));
    },
    step(groundY) {
      // The aim first, which the user is looking at; and one of the two in a frame: what a frame may spend is spent on one.
      if (aimDrape !== null && isLaid(aimDrape, groundY)) {
        for (const line of rings) line.set(aimDrape.points);
        aimDrape = nextAim;
        nextAim = null;
      } else if (aimDrape === null && edgeDrape !== null && isLaid(edgeDrape, groundY)) {
        // An edge beyond the ground is none: detail then ends where the survey does.
        const points = edgeDrape.onGround >= MIN_EDGE_PART ? edgeDrape.points : null;
        edgeCasing.set(points);
        edge.set(points);
        edgeDrape = null;
      }
      return aimDrape !== null || edgeDrape !== null;
    },
    setPath(points) {
      const packed = points.length < 2 ? null : Float32Array.from(points.flat());
      pathCasing.set(packed);
      path.set(packed);
    },
    setVisible(visible) {
      object.visible = visible;
    },
    resize(width, height) {
      for (const line of lines) line.resize(width, height);
    },
    dispose() {
      for (const line of lines) line.dispose();
    },
  };
}

/** Lay as much as a frame has time for; true when all is laid. */
function isLaid(drape: Drape, groundY: Heights): boolean {
  const endMs = performance.now() + DRAPE_MS;
  while (!drape.step(groundY, POINTS_AT_ONCE)) {
    if (performance.now() > endMs) return false;
  }
  return true;
}

function liftOf(radiusM: number): number {
  return Math.max(MIN_LIFT_M, radiusM * LIFT);
}

interface MarkerLine {
  readonly object: Group;
  set(points: Float32Array | null): void;
  /** Draw the first part of it, 0 to 1. */
  setShare(share: number): void;
  resize(width: number, height: number): void;
  dispose(): void;
}

function markerLine(colour: number, width: number, opacity: number): MarkerLine {
  const materials = [
    // Behind the ground.
    new LineMaterial({
      color: colour,
      linewidth: width,
      opacity: opacity * 0.22,
      transparent: true,
      depthTest: false,
      depthWrite: false,
    }),
    new LineMaterial({ color: colour, linewidth: width, opacity, transparent: true, depthWrite: false }),
  ];
  const object = new Group();
  object.visible = false;
  let segments = 0;
  let share = 1;
  // There from the start, unseen, so that the renderer can make its program before anything is shown.
  let geometry = new LineGeometry();
  geometry.setPositions([0, 0, 0, 0, 0, 1]);
  const lines = materials.map((material, order) => {
    const line = new Line2(geometry, material);
    line.renderOrder = 10 + order;
    line.frustumCulled = false;
    object.add(line);
    return line;
  });

  const applyShare = () => {
    geometry.instanceCount = Math.round(segments * share);
  };

  return {
    object,
    set(points) {
      object.visible = points !== null;
      if (points === null) return;
      // A geometry of its own for each set of points: LineGeometry cannot change its length.
      geometry.dispose();
      geometry = new LineGeometry();
      geometry.setPositions(points);
      segments = points.length / 3 - 1;
      for (const line of lines) line.geometry = geometry;
      applyShare();
    },
    setShare(next) {
      share = Math.min(1, Math.max(0, next));
      applyShare();
    },
    resize(x, y) {
      for (const material of materials) material.resolution.set(x, y);
    },
    dispose() {
      geometry.dispose();
      for (const material of materials) material.dispose();
    },
  };
}
