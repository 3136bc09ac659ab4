/** Where the user stands: the head as the headset reports it, the rig under it, and both together in the scene. */

import { type Camera, type Group, Vector3 } from "three";
import type { Vec3 } from "../core/types.ts";
import {
  azimuthOfYaw,
  facingOf,
  type HeadPose,
  keepAcrossReset,
  type RigPose,
  rigOver,
  toScene,
  turnAboutHead,
  yawOfQuaternion,
} from "./pose.ts";
import type { Standpoint } from "./types.ts";

export interface Stance {
  readonly pose: RigPose;
  /** In the play space. */
  readonly head: HeadPose;
  /** Where the head is in the scene's frame, metres. */
  readonly eye: Vec3;
  /** Which way the head looks in the scene, radians. */
  readonly facingRad: number;
  /** The head's position has become a guess in this frame: tracking was lost but for the turning. */
  readonly guessBegan: boolean;
  /** The ground under the head, as the play space has it. */
  standpoint(): Standpoint;
  /** Take the head of this frame. After the system has recentred the play space, the rig makes good for it. */
  read(viewer: XRViewerPose): void;
  /** Put the rig back where it belongs, whatever the page did with it. */
  settle(): void;
  /** The system has recentred: from the next frame on poses are in another frame. */
  recentred(): void;
  /** Put the head over the ground. */
  stand(ground: Vec3, facingRad: number): void;
  /** Turn about the head. */
  turn(angleRad: number): void;
}

/**
 * A stance at the scene's origin. `floorM`: height of the floor in the play space.
 *
 * Two frames meet here: the headset reports the head in the play space, and the rig is the play space's place and turn in the
 * scene. `eye` is the product of both, and is made anew whenever one of them changes.
 */
export function createStance(rig: Group, floorM: number): Stance {
  const position: [number, number, number] = [0, 0, 0];
  const head = { position, yawRad: 0 };
  let pose: RigPose = { position: [0, 0, 0], yawRad: 0 };
  let eye: Vec3 = [0, 0, 0];
  let guessed = false;
  let guessBegan = false;
  let headBeforeReset: HeadPose | null = null;
  const set = (next: RigPose): void => {
    pose = next;
    // Also where nothing changed: the page may have put its own camera somewhere, for when the session is over.
    rig.position.set(next.position[0], next.position[1], next.position[2]);
    rig.rotation.set(0, next.yawRad, 0);
    rig.updateMatrixWorld(true);
    eye = toScene(pose, head.position);
  };
  return {
    head,
    get pose() {
      return pose;
    },
    get eye() {
      return eye;
    },
    get facingRad() {
      return facingOf(pose, head);
    },
    get guessBegan() {
      return guessBegan;
    },
    standpoint() {
      return { place: [eye[0], pose.position[1] + floorM, eye[2]], yawDeg: azimuthOfYaw(facingOf(pose, head)) };
    },
    read(viewer) {
      const { orientation, position: at } = viewer.transform;
      position[0] = at.x;
      position[1] = at.y;
      position[2] = at.z;
      head.yawRad = yawOfQuaternion(orientation.x, orientation.y, orientation.z, orientation.w);
      guessBegan = viewer.emulatedPosition && !guessed;
      guessed = viewer.emulatedPosition;
      set(headBeforeReset === null ? pose : keepAcrossReset(pose, headBeforeReset, head));
      headBeforeReset = null;
    },
    settle() {
      set(pose);
    },
    recentred() {
      // Two of them before a frame: the head was last seen before the first.
      headBeforeReset ??= { position: [...position], yawRad: head.yawRad };
    },
    stand(ground, facingRad) {
      set(rigOver(ground, head, facingRad, floorM));
    },
    turn(angleRad) {
      set(turnAboutHead(pose, head, angleRad));
    },
  };
}

/** Where a camera of the page is, and which way it looks. */
export function standpointOf(camera: Camera): Standpoint {
  const position = camera.getWorldPosition(new Vector3());
  const along = camera.getWorldDirection(new Vector3());
  return { place: [position.x, position.y, position.z], yawDeg: azimuthOfYaw(Math.atan2(-along.x, -along.z)) };
}
