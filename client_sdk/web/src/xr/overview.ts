/**
 * The overview: a model of the scene at a table's height, to point at. Letting go lands there, however far it is.
 *
 * An arc reaches 33 m; a pit of 1.5 km would be 45 teleports. The model lies as the ground does, north to the north, so what is
 * behind the user is at its near side. It is a thing in the user's hands and no scenery: nothing of the ground changes by it.
 */

import {
  AlwaysDepth,
  BoxGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  Mesh,
  MeshBasicMaterial,
  type Object3D,
  PlaneGeometry,
  RingGeometry,
  SphereGeometry,
} from "three";
import type { Vec3 } from "../core/types.ts";
import type { GroundHit, Landings, MiniaturePose } from "../three/types.ts";
import type { Pointer } from "./inputs.ts";
import { miniatureBefore, onModel, rayOverGround } from "./overview-place.ts";
import { createPanel, drawPlate, FONT } from "./panel.ts";
import { panelBefore } from "./panel-place.ts";
import { createRibbon } from "./ribbon.ts";

const HINT_WIDTH = 1500;
const HINT_HEIGHT = 150;
export const HINT_FONT = 62;
/** The hint stands over the model, a little below the eyes and so far away. */
export const HINT_AWAY_M = 1.2;
const HINT_BELOW_M = 0.2;
/** What is drawn on the model: after it, by the depth that it left. */
const ON_MODEL = 890;
const AFTER_PANELS = 940;
/** The model is within the arm's reach: a ray is short. */
const RAY_FADE_M = 0.2;
/** A ring smaller than this cannot be seen in the hand, metres. */
const LEAST_RING_M = 0.012;

/** As far as there can be ground, metres. */
const SIGHT_M = 1e6;

/** Masts over the model, metres. */
const MAST_M = 0.05;

const HERE = new Color(0xffb02e);
const THERE = new Color(0x8fd3ff);

export interface Overview {
  readonly objects: readonly Object3D[];
  readonly open: boolean;
  /** Somebody points at the model with a pressed trigger. */
  readonly held: boolean;
  show(eye: Vec3, facingRad: number): void;
  hide(): void;
  /** Before the eyes again, after a turn. */
  follow(eye: Vec3, facingRad: number): void;
  /** Once a frame; `stood` is the ground under the user. */
  update(pointers: readonly Pointer[], eye: Vec3, stood: Vec3, facingRad: number): void;
  /** A press: true where it fell on the model. */
  press(pointer: Pointer): boolean;
  /** Let go: what of the ground was pointed at; null where nothing was, or another pointer had pressed. */
  release(pointer: Pointer): GroundHit | null;
  /** The press is taken back. `key` null: whoever pressed. */
  cancel(key: number | null): void;
  dispose(): void;
}

/**
 * An overview, hidden. `setMiniature` draws the scene's model; marks, ray and hint are its own, to be added to the scene by the
 * caller and freed by `dispose`.
 */
export function createOverview(
  landings: Landings,
  radiusM: () => number,
  setMiniature: (pose: MiniaturePose | null) => void,
): Overview {
  const marks = createMarks();
  const ray = createRibbon(2, AFTER_PANELS, RAY_FADE_M);
  const ends = new Float32Array(6);
  const hint = createPanel("overview-hint", HINT_WIDTH, HINT_HEIGHT);
  hint.draw(drawHint);
  let pose: MiniaturePose | null = null;
  let heldBy: number | null = null;
  const castOn = (pointer: Pointer): GroundHit | null =>
    pose !== null && pointer.hasRay
      ? landings.cast(rayOverGround(pose, pointer.origin), pointer.direction, SIGHT_M)
      : null;
  const place = (eye: Vec3, facingRad: number): void => {
    pose = miniatureBefore(landings.bounds, eye, facingRad);
    setMiniature(pose);
    hint.moveTo(panelBefore(eye, facingRad, HINT_AWAY_M, HINT_BELOW_M));
    marks.place(pose, landings.bounds);
  };
  const hide = (): void => {
    if (pose === null) return;
    pose = null;
    heldBy = null;
    setMiniature(null);
    marks.object.visible = false;
    hint.hide();
    ray.hide();
  };
  return {
    objects: [marks.object, ray.object, hint.object],
    get open() {
      return pose !== null;
    },
    get held() {
      return heldBy !== null;
    },
    show: place,
    hide,
    follow(eye, facingRad) {
      if (pose !== null) place(eye, facingRad);
    },
    update(pointers, eye, stood, facingRad) {
      if (pose === null) return;
      marks.stand(pose, stood, facingRad);
      // Who has pressed has the ray; else the first that points at the model.
      let hit: GroundHit | null = null;
      for (const pointer of pointers) {
        if (!pointer.tracked || (heldBy !== null && pointer.key !== heldBy)) continue;
        hit = castOn(pointer);
        if (hit !== null) {
          const on = onModel(pose, hit.position);
          ends.set(pointer.origin, 0);
          ends.set(on, 3);
          break;
        }
      }
      marks.point(hit === null ? null : onModel(pose, hit.position), Math.max(LEAST_RING_M, pose.scale * radiusM()));
      if (hit === null) ray.hide();
      else ray.draw(ends, 2, eye, true);
    },
    press(pointer) {
      const hit = castOn(pointer);
      if (hit === null) return false;
      heldBy = pointer.key;
      // While he looks whether it is the right place, what it needs is on its way.
      landings.prefetch(hit.position, radiusM());
      return true;
    },
    release(pointer) {
      if (heldBy !== pointer.key) return null;
      heldBy = null;
      return castOn(pointer);
    },
    cancel(key) {
      if (key === null || key === heldBy) heldBy = null;
    },
    dispose() {
      hide();
      marks.dispose();
      ray.dispose();
      hint.dispose();
    },
  };
}

/** What is drawn on and around the model. */
interface Marks {
  readonly object: Group;
  place(pose: MiniaturePose, bounds: Landings["bounds"]): void;
  stand(pose: MiniaturePose, stood: Vec3, facingRad: number): void;
  point(on: Vec3 | null, ringM: number): void;
  dispose(): void;
}

function createMarks(): Marks {
  const object = new Group();
  object.name = "overview-marks";
  object.visible = false;
  const hereMaterial = new MeshBasicMaterial({ color: HERE, fog: false });
  const thereMaterial = new MeshBasicMaterial({ color: THERE, fog: false, side: 2 });
  // Under the model, over the ground: what lies behind the model would confuse its outline.
  const plateMaterial = new MeshBasicMaterial({ color: 0x10141a, fog: false, depthFunc: AlwaysDepth, side: 2 });
  const geometries = {
    cone: new ConeGeometry(0.009, 0.035, 12).rotateX(-Math.PI / 2).translate(0, 0, -0.005),
    mast: new CylinderGeometry(0.002, 0.002, 1, 6).translate(0, 0.5, 0),
    head: new SphereGeometry(0.007, 12, 8).translate(0, MAST_M, 0),
    ring: new RingGeometry(0.94, 1, 64).rotateX(-Math.PI / 2),
    plate: new PlaneGeometry(1, 1).rotateX(-Math.PI / 2),
    north: new BoxGeometry(0.008, 0.004, 0.05),
  };
  const make = (geometry: keyof typeof geometries, material: MeshBasicMaterial, order: number): Mesh => {
    const mesh = new Mesh(geometries[geometry], material);
    mesh.renderOrder = order;
    object.add(mesh);
    return mesh;
  };
  // Before the model, which then clears the depth: the plate hides nothing of it.
  const plate = make("plate", plateMaterial, ON_MODEL - 11);
  const north = make("north", thereMaterial, ON_MODEL);
  const [hereMast, here] = [make("mast", hereMaterial, ON_MODEL), make("cone", hereMaterial, ON_MODEL)];
  const [mast, ring] = [make("mast", thereMaterial, ON_MODEL), make("ring", thereMaterial, ON_MODEL)];
  const head = make("head", thereMaterial, ON_MODEL);
  hereMast.scale.y = MAST_M;
  mast.scale.y = MAST_M;
  return {
    object,
    place({ at, scale }, [x0, , z0, x1, , z1]) {
      const [widthM, lengthM] = [scale * (x1 - x0) + 0.06, scale * (z1 - z0) + 0.06];
      plate.position.set(at[0], at[1] - 0.004, at[2]);
      plate.scale.set(widthM, 1, lengthM);
      north.position.set(at[0], at[1], at[2] - lengthM / 2 - 0.03);
      object.visible = true;
    },
    stand(pose, stood, facingRad) {
      const on = onModel(pose, stood);
      hereMast.position.set(...on);
      here.position.set(on[0], on[1] + MAST_M, on[2]);
      here.rotation.y = facingRad;
    },
    point(on, ringM) {
      mast.visible = on !== null;
      head.visible = on !== null;
      ring.visible = on !== null;
      if (on === null) return;
      mast.position.set(...on);
      head.position.set(...on);
      ring.position.set(on[0], on[1] + 0.004, on[2]);
      ring.scale.set(ringM, 1, ringM);
    },
    dispose() {
      for (const geometry of Object.values(geometries)) geometry.dispose();
      for (const material of [hereMaterial, thereMaterial, plateMaterial]) material.dispose();
    },
  };
}

function drawHint(context: CanvasRenderingContext2D): void {
  drawPlate(context, HINT_WIDTH, HINT_HEIGHT, "rgba(16, 20, 26, 0.92)", "#55677a");
  context.textBaseline = "middle";
  context.textAlign = "center";
  context.fillStyle = "#f2f5f8";
  context.font = `500 ${HINT_FONT}px ${FONT}`;
  context.fillText("Point at the model and let go to land there", HINT_WIDTH / 2, HINT_HEIGHT / 2, HINT_WIDTH - 80);
}
