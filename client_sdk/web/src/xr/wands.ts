/** What the user sees of their own hands: plain wands for controllers, joints for hands. Shapes of our own, nothing is loaded. */

import {
  CapsuleGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  IcosahedronGeometry,
  InstancedMesh,
  Mesh,
  ShaderMaterial,
} from "three";
import type { Pointer } from "./inputs.ts";

const JOINTS = 25;
const AFTER_PANELS = 950;

// Lit from above by its own shader: the scene has no lamps.
const VERTEX = /* glsl */ `
varying float vLight;
void main() {
  vec4 place = vec4(position, 1.0);
  vec3 facing = normal;
  #ifdef USE_INSTANCING
    place = instanceMatrix * place;
    facing = mat3(instanceMatrix) * facing;
  #endif
  vLight = 0.62 + 0.38 * normalize(mat3(modelMatrix) * facing).y;
  gl_Position = projectionMatrix * modelViewMatrix * place;
}`;

const FRAGMENT = /* glsl */ `
uniform vec3 uColour;
varying float vLight;
void main() {
  gl_FragColor = vec4(uColour * vLight, 1.0);
  #include <colorspace_fragment>
}`;

/** Reads all joints at once; not in the type definitions, but wherever there are hands. */
interface JointReader {
  fillPoses?(spaces: readonly XRSpace[], base: XRSpace, transforms: Float32Array): boolean;
  fillJointRadii?(spaces: readonly XRSpace[], radii: Float32Array): boolean;
}

interface Drawn {
  readonly wand: Mesh;
  readonly joints: InstancedMesh;
  readonly spaces: readonly XRSpace[];
  readonly radii: Float32Array;
  /** The wrist's matrix in the play space is at the beginning, where the hand is tracked. */
  readonly matrices: Float32Array;
  handTracked: boolean;
}

export interface Wands {
  /** Child of the rig: its own places are of the play space. */
  readonly object: Group;
  update(frame: XRFrame, space: XRReferenceSpace, pointers: readonly Pointer[]): void;
  /** Matrices of a hand's joints in the play space, the wrist first; null where it is no hand, or not tracked. */
  jointsOf(pointer: Pointer): Float32Array | null;
  remove(pointer: Pointer): void;
  hide(): void;
  dispose(): void;
}

/** Nobody's hands yet. */
export function createWands(): Wands {
  const object = new Group();
  object.name = "hands";
  const material = new ShaderMaterial({
    uniforms: { uColour: { value: new Color(0x9aa6b2) } },
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    // Opaque all the same: with the transparent things it is drawn after the panels, which hide what is behind them.
    transparent: true,
  });
  // Shared by all pointers, and freed once; of a pointer's own there is the instance buffer alone.
  const wandGeometry = new CapsuleGeometry(0.016, 0.085, 4, 12).rotateX(Math.PI / 2);
  const jointGeometry = new IcosahedronGeometry(1, 1);
  const drawn = new Map<Pointer, Drawn>();
  const find = (pointer: Pointer): Drawn => {
    let drawnPointer = drawn.get(pointer);
    if (drawnPointer === undefined) {
      drawnPointer = newDrawn(
        pointer,
        new Mesh(wandGeometry, material),
        new InstancedMesh(jointGeometry, material, JOINTS),
      );
      drawn.set(pointer, drawnPointer);
      object.add(drawnPointer.wand, drawnPointer.joints);
    }
    return drawnPointer;
  };
  return {
    object,
    update(frame, space, pointers) {
      object.visible = true;
      for (const pointer of pointers) {
        const each = find(pointer);
        if (each.spaces.length > 0) {
          updateJoints(each, frame as XRFrame & JointReader, space);
        } else {
          updateWand(each.wand, pointer, frame, space);
        }
      }
    },
    jointsOf(pointer) {
      const drawnPointer = drawn.get(pointer);
      return drawnPointer?.handTracked === true ? drawnPointer.matrices : null;
    },
    remove(pointer) {
      const drawnPointer = drawn.get(pointer);
      if (drawnPointer !== undefined) {
        object.remove(drawnPointer.wand, drawnPointer.joints);
        drawnPointer.joints.dispose();
        drawn.delete(pointer);
      }
    },
    hide() {
      object.visible = false;
    },
    dispose() {
      for (const each of drawn.values()) {
        each.joints.dispose();
      }
      drawn.clear();
      object.clear();
      wandGeometry.dispose();
      jointGeometry.dispose();
      material.dispose();
    },
  };
}

function newDrawn(pointer: Pointer, wand: Mesh, joints: InstancedMesh): Drawn {
  wand.matrixAutoUpdate = false;
  wand.visible = false;
  wand.renderOrder = AFTER_PANELS;
  joints.instanceMatrix.setUsage(DynamicDrawUsage);
  // Its bounding sphere would be that of the first frame.
  joints.frustumCulled = false;
  joints.visible = false;
  joints.renderOrder = AFTER_PANELS;
  const { hand } = pointer.source;
  return {
    wand,
    joints,
    spaces: hand === undefined || hand === null ? [] : [...hand.values()],
    radii: new Float32Array(JOINTS),
    matrices: new Float32Array(16 * JOINTS),
    handTracked: false,
  };
}

function updateWand(wand: Mesh, pointer: Pointer, frame: XRFrame, space: XRReferenceSpace): void {
  const { gripSpace } = pointer.source;
  const pose = gripSpace === undefined || gripSpace === null ? undefined : frame.getPose(gripSpace, space);
  wand.visible = pose !== undefined && pose !== null;
  if (pose !== undefined && pose !== null) {
    wand.matrix.fromArray(pose.transform.matrix);
    wand.matrixWorldNeedsUpdate = true;
  }
}

function updateJoints(each: Drawn, frame: XRFrame & JointReader, space: XRReferenceSpace): void {
  const { joints, matrices, radii, spaces } = each;
  const read =
    (frame.fillPoses?.(spaces, space, matrices) ?? false) && (frame.fillJointRadii?.(spaces, radii) ?? false);
  each.handTracked = read;
  joints.visible = read;
  if (!read) {
    return;
  }
  const out = joints.instanceMatrix.array;
  for (let k = 0; k < spaces.length; k++) {
    for (let entry = 0; entry < 16; entry++) {
      // The first three columns turn and scale; the fourth is the place.
      out[16 * k + entry] = matrices[16 * k + entry]! * (entry < 12 ? radii[k]! : 1);
    }
  }
  joints.count = spaces.length;
  joints.instanceMatrix.needsUpdate = true;
}
