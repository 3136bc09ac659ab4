/** Where the eye is: orbiting or walking, and the way between the two. */

import { type Group, type PerspectiveCamera, Vector3 } from "three";
import type { Bounds, Vec3 } from "../../core/types.ts";
import {
  farthest,
  framing,
  type OrbitPose,
  orbitEye,
  panned,
  turned,
  wrapped,
  zoomed,
} from "../../three/orbit-pose.ts";
import { prefersLessMotion } from "../device.ts";
import type { Look, ViewKind } from "../route.ts";
import {
  clampNod,
  type GroundHeight,
  isSettling,
  placed,
  type WalkInput,
  type WalkPose,
  walkEye,
  walked,
} from "../walk-pose.ts";

/** A ray through a pixel: from the eye, `direction` of length 1, in the scene's frame. */
export interface Ray {
  readonly origin: Vec3;
  readonly direction: Vec3;
}

/** A pose that somebody else set: an embedding page, or a test. */
export interface FreePose {
  readonly eye: Vec3;
  readonly yawDeg: number;
  readonly pitchDeg: number;
}

/** Moves rig and camera. While a headset is shown nothing here is called. */
export interface CameraDesk {
  readonly view: ViewKind;
  readonly eye: Vec3;
  /** Feet, or what the eye turns about. */
  readonly focus: Vec3;
  readonly yawDeg: number;
  /** Where the walker stands, or stood last. */
  readonly stood: Vec3;
  readonly look: Look;
  /** Whether all of the scene is looked at, as at the start. */
  readonly isHome: boolean;
  /** From the ground up above it. Down is {@link moveTo}'s: whoever stands must stand somewhere. */
  setView(view: "orbit"): void;
  /** Dragged by so many CSS pixels. */
  drag(dx: number, dy: number): void;
  pan(dx: number, dy: number): void;
  twist(degrees: number): void;
  zoom(factor: number, about: Vec3 | null): void;
  home(): void;
  /** Stand there (walk), or turn about it (orbit); `glides`: on a way that can be seen. */
  moveTo(at: Vec3, look: Look | null, glides: boolean): void;
  setFree(pose: FreePose | null): void;
  resize(width: number, height: number): void;
  /** A ray through a point of the canvas, CSS pixels. */
  rayAt(x: number, y: number): Ray;
  /** Where a point of the scene is on the canvas; null behind the eye. */
  pixelOf(position: Vec3): { readonly x: number; readonly y: number } | null;
  /** One frame; true while it still moves. */
  update(timeMs: number, dtS: number, input: WalkInput, zoomKeys: number): boolean;
}

const GLIDE_MS = 450;
/** From above down to the ground: long enough to see where one goes. */
const FLIGHT_MS = 900;
/** How far above the ground the last part of a flight comes straight down, of the way. */
const FLIGHT_RISE = 0.35;
const DEGREES_PER_PIXEL = 0.22;
/** Keys turn an orbit by so much a second. */
const ORBIT_KEYS_DEG_PER_S = 70;

/**
 * A desk that looks at all of the scene.
 *
 * Orbit and walk each keep their own pose, and one of them is in force (`view`); a free pose of an embedding page goes before
 * both. The rig carries the position in the scene's frame and the camera only the rotation: a headset takes the rig over and
 * finds its origin where the user is.
 */
export function createCameraDesk(
  rig: Group,
  camera: PerspectiveCamera,
  bounds: Bounds,
  ground: GroundHeight,
): CameraDesk {
  let view: ViewKind = "orbit";
  let width = 1;
  let height = 1;
  let orbit: OrbitPose = framing(bounds, camera.fov, camera.aspect);
  let isHome = true;
  let walk: WalkPose = placed(orbit.target, 0, 0, ground);
  let free: FreePose | null = null;
  let glide: { readonly from: OrbitPose; readonly to: OrbitPose; startMs: number | null } | null = null;
  /** The way from above to where the walker stands; nothing but the picture knows of it. */
  let flight: { readonly from: FreePose; startMs: number | null; share: number } | null = null;
  const maxDistanceM = farthest(bounds);
  const homeDistanceM = orbit.distanceM;
  const vector = new Vector3();

  function poseNow(): FreePose {
    if (free !== null) return free;
    const pose = view === "orbit" ? orbit : walk;
    const to = {
      eye: view === "orbit" ? orbitEye(orbit) : walkEye(walk),
      yawDeg: pose.yawDeg,
      pitchDeg: pose.pitchDeg,
    };
    return flight === null ? to : onTheWay(flight.from, to, flight.share);
  }

  function apply(): void {
    const { eye, yawDeg, pitchDeg } = poseNow();
    // The one place where the two poses are written.
    rig.position.set(...eye);
    rig.rotation.set(0, 0, 0);
    camera.position.set(0, 0, 0);
    camera.rotation.set(radians(pitchDeg), radians(-yawDeg), 0, "YXZ");
    // Depth is finest where the user looks: near enough not to cut the ground at the feet, no nearer.
    const near = (view === "walk" && flight === null) || free !== null ? 0.1 : Math.max(0.1, orbit.distanceM * 0.004);
    const far = maxDistanceM * 1.6;
    if (camera.near !== near || camera.far !== far) {
      camera.near = near;
      camera.far = far;
      camera.updateProjectionMatrix();
    }
    rig.updateMatrixWorld(true);
  }

  /** Go to a pose over some frames; any move of the user ends it where it is. */
  function glideTo(to: OrbitPose): void {
    if (prefersLessMotion()) {
      orbit = to;
      glide = null;
    } else {
      glide = { from: orbit, to, startMs: null };
    }
  }

  /** Metres on the ground, at the target's distance, of one CSS pixel. */
  function metresPerPixel(): number {
    return (2 * orbit.distanceM * Math.tan(radians(camera.fov) / 2)) / height;
  }

  function orbitByKeys(dtS: number, input: WalkInput, zoomKeys: number): boolean {
    const panSize = orbit.distanceM * dtS * (input.fast ? 1.2 : 0.5);
    const orbitBefore = orbit;
    if (input.turn !== 0 || input.nod !== 0) {
      orbit = turned(orbit, input.turn * ORBIT_KEYS_DEG_PER_S * dtS, input.nod * ORBIT_KEYS_DEG_PER_S * dtS);
    }
    if (input.forward !== 0 || input.right !== 0) orbit = panned(orbit, input.right * panSize, input.forward * panSize);
    if (zoomKeys !== 0) orbit = zoomed(orbit, Math.exp(-zoomKeys * 1.4 * dtS), maxDistanceM);
    if (orbit !== orbitBefore) moved();
    return input.turn !== 0 || input.nod !== 0 || input.forward !== 0 || input.right !== 0 || zoomKeys !== 0;
  }

  /** The user took over: nothing moves by itself any more, and the opening view is given up. */
  function moved(): void {
    glide = null;
    flight = null;
    free = null;
    isHome = false;
  }

  apply();
  return {
    get view() {
      return view;
    },
    get eye() {
      return free?.eye ?? (view === "orbit" ? orbitEye(orbit) : walkEye(walk));
    },
    get focus() {
      return view === "orbit" ? orbit.target : walk.feet;
    },
    get yawDeg() {
      return view === "orbit" ? orbit.yawDeg : walk.yawDeg;
    },
    get isHome() {
      return isHome && view === "orbit";
    },
    get stood() {
      return walk.feet;
    },
    get look() {
      const pose = view === "orbit" ? (glide?.to ?? orbit) : walk;
      return {
        view,
        yawDeg: pose.yawDeg,
        pitchDeg: pose.pitchDeg,
        distanceM: view === "orbit" ? (glide?.to ?? orbit).distanceM : null,
        focus: view === "orbit" ? (glide?.to ?? orbit).target : walk.feet,
      };
    },
    setView(next) {
      free = null;
      glide = null;
      flight = null;
      if (next === view) return;
      orbit = { target: walk.feet, yawDeg: walk.yawDeg, pitchDeg: -35, distanceM: Math.min(homeDistanceM, 70) };
      isHome = false;
      view = next;
      apply();
    },
    drag(dx, dy) {
      if (view === "orbit") {
        orbit = turned(orbit, dx * DEGREES_PER_PIXEL, dy * -DEGREES_PER_PIXEL);
      } else {
        // The ground follows the hand, as on a map: drag left to look right.
        const yawDeg = wrapped(walk.yawDeg - dx * DEGREES_PER_PIXEL);
        walk = { ...walk, yawDeg, pitchDeg: clampNod(walk.pitchDeg + dy * DEGREES_PER_PIXEL) };
      }
      moved();
    },
    pan(dx, dy) {
      if (view !== "orbit") return;
      const metres = metresPerPixel();
      // Foreshortened by the slant: the ground stays under the pointer.
      const slant = Math.max(0.25, Math.sin(radians(Math.abs(orbit.pitchDeg))));
      orbit = panned(orbit, -dx * metres, (dy * metres) / slant);
      moved();
    },
    twist(degrees) {
      if (view !== "orbit") return;
      orbit = turned(orbit, degrees, 0);
      moved();
    },
    zoom(factor, about) {
      if (view !== "orbit") return;
      orbit = zoomed(orbit, factor, maxDistanceM, about);
      moved();
    },
    home() {
      free = null;
      flight = null;
      if (view === "walk") {
        view = "orbit";
        orbit = framing(bounds, camera.fov, camera.aspect);
      } else {
        glideTo(framing(bounds, camera.fov, camera.aspect));
      }
      isHome = true;
    },
    moveTo(at, look, glides) {
      const from = poseNow();
      free = null;
      flight = null;
      view = look?.view ?? view;
      if (view === "walk") {
        glide = null;
        walk = placed(look?.focus ?? at, look?.yawDeg ?? walk.yawDeg, look?.pitchDeg ?? walk.pitchDeg, ground);
        if (glides && !prefersLessMotion()) flight = { from, startMs: null, share: 0 };
      } else {
        const to: OrbitPose = {
          target: look?.focus ?? at,
          yawDeg: look?.yawDeg ?? orbit.yawDeg,
          pitchDeg: look?.pitchDeg ?? orbit.pitchDeg,
          distanceM: Math.min(maxDistanceM, look?.distanceM ?? orbit.distanceM),
        };
        if (glides) glideTo(to);
        else {
          glide = null;
          orbit = to;
        }
        isHome = false;
      }
      apply();
    },
    setFree(pose) {
      free = pose;
      glide = null;
      flight = null;
      apply();
    },
    resize(nextWidth, nextHeight) {
      width = Math.max(1, nextWidth);
      height = Math.max(1, nextHeight);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      // The opening view frames the scene in whatever window it is; what the user chose stays.
      if (isHome && view === "orbit") orbit = framing(bounds, camera.fov, camera.aspect);
      apply();
    },
    rayAt(x, y) {
      // `unproject` needs the matrices of `apply`: from the pixel at half depth, seen from the eye.
      vector.set((x / width) * 2 - 1, 1 - (y / height) * 2, 0.5).unproject(camera);
      const origin = camera.getWorldPosition(new Vector3());
      vector.sub(origin).normalize();
      return { origin: [origin.x, origin.y, origin.z], direction: [vector.x, vector.y, vector.z] };
    },
    pixelOf(position) {
      // Normalised device coordinates: beyond 1 in depth is behind the eye, or past the far plane.
      vector.set(...position).project(camera);
      if (vector.z > 1) return null;
      return { x: ((vector.x + 1) / 2) * width, y: ((1 - vector.y) / 2) * height };
    },
    update(timeMs, dtS, input, zoomKeys) {
      let moves = false;
      if (view === "orbit") {
        moves = orbitByKeys(dtS, input, zoomKeys);
        if (glide !== null) {
          glide.startMs ??= timeMs;
          const share = Math.min(1, (timeMs - glide.startMs) / GLIDE_MS);
          orbit = between(glide.from, glide.to, share * share * (3 - 2 * share));
          moves = true;
          if (share === 1) glide = null;
        }
      } else {
        if (flight !== null) {
          flight.startMs ??= timeMs;
          flight.share = Math.min(1, (timeMs - flight.startMs) / FLIGHT_MS);
          moves = true;
          if (flight.share === 1) flight = null;
        }
        const wants = input.forward !== 0 || input.right !== 0 || input.turn !== 0 || input.nod !== 0;
        if (wants) moved();
        if (wants || isSettling(walk)) {
          walk = walked(walk, input, dtS, ground);
          moves = true;
        }
      }
      apply();
      return moves;
    },
  };
}

/** From above in a curve that ends in coming straight down: a line would lead through whatever stands before the place. */
function onTheWay(from: FreePose, to: FreePose, part: number): FreePose {
  const share = part * part * (3 - 2 * part);
  const turnDeg = ((to.yawDeg - from.yawDeg + 540) % 360) - 180;
  const wayM = Math.hypot(from.eye[0] - to.eye[0], from.eye[1] - to.eye[1], from.eye[2] - to.eye[2]);
  const over: Vec3 = [to.eye[0], Math.max(from.eye[1], to.eye[1] + FLIGHT_RISE * wayM), to.eye[2]];
  const on = (axis: 0 | 1 | 2) =>
    (1 - share) ** 2 * from.eye[axis] + 2 * share * (1 - share) * over[axis] + share ** 2 * to.eye[axis];
  return {
    eye: [on(0), on(1), on(2)],
    yawDeg: wrapped(from.yawDeg + turnDeg * share),
    pitchDeg: from.pitchDeg + (to.pitchDeg - from.pitchDeg) * share,
  };
}

function between(from: OrbitPose, to: OrbitPose, share: number): OrbitPose {
  const mix = (a: number, b: number) => a + (b - a) * share;
  // The short way round.
  const turnDeg = ((to.yawDeg - from.yawDeg + 540) % 360) - 180;
  return {
    target: [mix(from.target[0], to.target[0]), mix(from.target[1], to.target[1]), mix(from.target[2], to.target[2])],
    yawDeg: wrapped(from.yawDeg + turnDeg * share),
    pitchDeg: mix(from.pitchDeg, to.pitchDeg),
    distanceM: mix(from.distanceM, to.distanceM),
  };
}

function radians(degrees: number): number {
  return (degrees * Math.PI) / 180;
}
