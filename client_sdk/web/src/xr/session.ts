/** Asking the browser for a session, setting it up for the device, and giving the page its camera back. */

import type { Group, PerspectiveCamera, WebGLRenderer } from "three";
import { chooseFrameRate, type HeadsetProfile, profileOf } from "./device.ts";
import { EYE_HEIGHT_M } from "./pose.ts";

/** Hands and tools come nearer than the page's camera ever is to anything; metres. */
const NEAR_M = 0.1;

export interface Started {
  readonly session: XRSession;
  readonly space: XRReferenceSpace;
  /** Height of the floor in the play space: 0, or below the eyes where the system knows no floor. */
  readonly floorM: number;
  readonly profile: HeadsetProfile;
  readonly frameRateHz: number | null;
}

/** Whether this browser can show a headset view at all. */
export async function headsetSupported(): Promise<boolean> {
  try {
    return (await navigator.xr?.isSessionSupported("immersive-vr")) ?? false;
  } catch {
    // A page that is not allowed to ask (a frame's permissions) cannot show it either.
    return false;
  }
}

/**
 * Ask for a session. To be called straight from a click: the browser wants the user's own will.
 *
 * All features are optional: without a floor the user sits, without hands there are controllers. `layers` because three.js
 * uses projection layers wherever the browser has them.
 */
export function requestSession(): Promise<XRSession> {
  if (navigator.xr === undefined) {
    return Promise.reject(new Error("this browser has no WebXR; a headset's own browser does"));
  }
  return navigator.xr.requestSession("immersive-vr", {
    optionalFeatures: ["local-floor", "bounded-floor", "hand-tracking", "layers"],
  });
}

/** Give the session to the renderer, with the best that the device can do. Ends it where that fails. */
export async function startSession(renderer: WebGLRenderer, session: XRSession): Promise<Started> {
  try {
    const profile = profileOf(navigator.userAgent);
    const hasFloor = await offersFloor(session);
    // three.js reads these when the session is set: afterwards they are too late.
    renderer.xr.setReferenceSpaceType(hasFloor ? "local-floor" : "local");
    renderer.xr.setFramebufferScaleFactor(profile.framebufferScale);
    renderer.xr.setFoveation(profile.foveation);
    await renderer.xr.setSession(session);
    const frameRateHz = await askFrameRate(session, profile.frameRateHz);
    const space = renderer.xr.getReferenceSpace();
    if (space === null) {
      throw new Error("the headset gave no reference space");
    }
    return { session, space, floorM: hasFloor ? 0 : -EYE_HEIGHT_M, profile, frameRateHz };
  } catch (error) {
    await session.end().catch(() => undefined);
    throw error;
  }
}

async function offersFloor(session: XRSession): Promise<boolean> {
  try {
    await session.requestReferenceSpace("local-floor");
    return true;
  } catch {
    return false;
  }
}

async function askFrameRate(session: XRSession, wantedHz: number): Promise<number | null> {
  const rate = chooseFrameRate(session.supportedFrameRates, wantedHz);
  if (rate === null || session.frameRate === rate) {
    return session.frameRate ?? null;
  }
  try {
    await session.updateTargetFrameRate(rate);
    return rate;
  } catch {
    // The system keeps the rate that it has.
    return session.frameRate ?? null;
  }
}

/** Remember how the page's camera stands, and set it up for the headset. The function returned puts all of it back. */
export function borrowCamera(camera: PerspectiveCamera, rig: Group): () => void {
  const rigPosition = rig.position.clone();
  const rigQuaternion = rig.quaternion.clone();
  const position = camera.position.clone();
  const quaternion = camera.quaternion.clone();
  const scale = camera.scale.clone();
  const { near } = camera;
  // No projection from it: three.js hands it to the session, which makes one for each eye.
  camera.near = NEAR_M;
  return () => {
    rig.position.copy(rigPosition);
    rig.quaternion.copy(rigQuaternion);
    camera.position.copy(position);
    camera.quaternion.copy(quaternion);
    camera.scale.copy(scale);
    camera.near = near;
    camera.updateProjectionMatrix();
    rig.updateMatrixWorld(true);
  };
}
