/** The session's input sources: controllers, hands and whatever else points, with their rays in the scene. */

import type { RigPose } from "./pose.ts";
import { newStick, type Stick } from "./snap.ts";

/** Buttons of the layout "xr-standard". */
const MENU_BUTTON = 4;
const CANCEL_BUTTON = 5;
/** Axes of the thumbstick there; 0 and 1 are a touchpad's. */
const STICK_X = 2;
const STICK_Y = 3;

/** A controller, a hand or a gaze. The same object as long as the source is there; its arrays are written in place. */
export interface Pointer {
  readonly key: number;
  readonly source: XRInputSource;
  readonly stick: Stick;
  /** Its ray in the scene; of the last frame in which it was tracked. */
  readonly origin: [number, number, number];
  /** Unit. */
  readonly direction: [number, number, number];
  tracked: boolean;
  /** It has had a ray at all. */
  hasRay: boolean;
  stickX: number;
  stickY: number;
  menuDown: boolean;
  cancelDown: boolean;
  /** Its `select` came since its last `selectend`: the press was not cut short. */
  selected: boolean;
}

export interface InputHandlers {
  readonly selectStart: (pointer: Pointer) => void;
  /** `completed` false: the system took the press away (a lost hand, a system gesture). */
  readonly selectEnd: (pointer: Pointer, completed: boolean) => void;
  readonly squeeze: (pointer: Pointer) => void;
  readonly removed: (pointer: Pointer) => void;
}

export interface Inputs {
  readonly pointers: readonly Pointer[];
  /** Read rays, sticks and buttons of this frame. */
  update(frame: XRFrame, space: XRReferenceSpace, rig: RigPose): void;
  /** Buttons that went down since the last call, on any controller. */
  pressed(pointer: Pointer): "menu" | "cancel" | null;
  dispose(): void;
}

/** Listen to a session. `current` gives what a ray in an event is read by. */
export function listenInputs(
  session: XRSession,
  handlers: InputHandlers,
  current: () => { readonly space: XRReferenceSpace | null; readonly rig: RigPose },
): Inputs {
  const pointers: Pointer[] = [];
  let nextKey = 0;
  // By identity of the source: a pointer keeps its key, and with it an aim, as long as the source is there.
  const find = (source: XRInputSource): Pointer => {
    let pointer = pointers.find((each) => each.source === source);
    if (pointer === undefined) {
      pointer = newPointer(nextKey, source);
      nextKey += 1;
      pointers.push(pointer);
    }
    return pointer;
  };
  const onChange = (event: XRInputSourcesChangeEvent): void => {
    for (const source of event.removed) {
      const index = pointers.findIndex((each) => each.source === source);
      if (index >= 0) {
        handlers.removed(pointers[index]!);
        pointers.splice(index, 1);
      }
    }
    for (const source of event.added) {
      find(source);
    }
  };
  const onStart = (event: XRInputSourceEvent): void => {
    const pointer = find(event.inputSource);
    const { space, rig } = current();
    if (space !== null) {
      // Inputs that exist only while they are pressed (a look and a pinch) have no ray from an earlier frame.
      readRay(pointer, event.frame, space, rig);
    }
    handlers.selectStart(pointer);
  };
  const onSelect = (event: XRInputSourceEvent): void => {
    find(event.inputSource).selected = true;
  };
  const onEnd = (event: XRInputSourceEvent): void => {
    // The order is start, select, end; the emulator sends select first. So the mark is cleared here only.
    const pointer = find(event.inputSource);
    const completed = pointer.selected;
    pointer.selected = false;
    handlers.selectEnd(pointer, completed);
  };
  const onSqueeze = (event: XRInputSourceEvent): void => handlers.squeeze(find(event.inputSource));
  session.addEventListener("inputsourceschange", onChange);
  session.addEventListener("selectstart", onStart);
  session.addEventListener("select", onSelect);
  session.addEventListener("selectend", onEnd);
  session.addEventListener("squeezestart", onSqueeze);
  // Sources that were there before this listened come in no event.
  for (const source of session.inputSources ?? []) {
    find(source);
  }
  return {
    pointers,
    update(frame, space, rig) {
      for (const pointer of pointers) {
        readRay(pointer, frame, space, rig);
        const axes = pointer.source.gamepad?.axes;
        pointer.stickX = axes?.[STICK_X] ?? 0;
        pointer.stickY = axes?.[STICK_Y] ?? 0;
      }
    },
    pressed(pointer) {
      const buttons = pointer.source.gamepad?.buttons;
      const menu = buttons?.[MENU_BUTTON]?.pressed ?? false;
      const cancel = buttons?.[CANCEL_BUTTON]?.pressed ?? false;
      const menuNow = menu && !pointer.menuDown;
      const cancelNow = cancel && !pointer.cancelDown;
      pointer.menuDown = menu;
      pointer.cancelDown = cancel;
      if (menuNow) {
        return "menu";
      }
      return cancelNow ? "cancel" : null;
    },
    dispose() {
      session.removeEventListener("inputsourceschange", onChange);
      session.removeEventListener("selectstart", onStart);
      session.removeEventListener("select", onSelect);
      session.removeEventListener("selectend", onEnd);
      session.removeEventListener("squeezestart", onSqueeze);
      pointers.length = 0;
    },
  };
}

/** Whether it points by a hand, seen or only felt: letting go moves it. */
export function isHand({ hand, targetRayMode }: XRInputSource): boolean {
  return targetRayMode === "transient-pointer" || (hand !== undefined && hand !== null);
}

function newPointer(key: number, source: XRInputSource): Pointer {
  return {
    key,
    source,
    stick: newStick(),
    origin: [0, 0, 0],
    direction: [0, 0, -1],
    tracked: false,
    hasRay: false,
    stickX: 0,
    stickY: 0,
    menuDown: false,
    cancelDown: false,
    selected: false,
  };
}

function readRay(pointer: Pointer, frame: XRFrame, space: XRReferenceSpace, rig: RigPose): void {
  const pose = frame.getPose(pointer.source.targetRaySpace, space);
  if (pose === undefined || pose === null) {
    pointer.tracked = false;
    return;
  }
  const m = pose.transform.matrix;
  const cos = Math.cos(rig.yawRad);
  const sin = Math.sin(rig.yawRad);
  pointer.origin[0] = rig.position[0] + m[12]! * cos + m[14]! * sin;
  pointer.origin[1] = rig.position[1] + m[13]!;
  pointer.origin[2] = rig.position[2] - m[12]! * sin + m[14]! * cos;
  pointer.direction[0] = -(m[8]! * cos + m[10]! * sin);
  pointer.direction[1] = -m[9]!;
  pointer.direction[2] = m[8]! * sin - m[10]! * cos;
  pointer.tracked = true;
  pointer.hasRay = true;
}
