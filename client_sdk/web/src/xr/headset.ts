/**
 * The headset view: one call enters it, the page's loop drives it, one call leaves it.
 *
 * Between landings nothing here changes what is drawn of the scene: the head moves the camera, the sticks turn the rig, and arc,
 * ring, panels, hands and veil are no scenery. `Landings.swap` is called in one place, `showLanding`, in a frame that is drawn
 * black.
 */

import type { Object3D } from "three";
import type { StreamEvent, Vec3 } from "../core/types.ts";
import { createAiming } from "./aiming.ts";
import { createBoard } from "./board.ts";
import { addTime, newFrameTimes, summarise } from "./frames.ts";
import { listenInputs, type Pointer } from "./inputs.ts";
import { type Announced, messageOf, sentence, statusLine } from "./messages.ts";
import { holdPalm, newPalmHold, palmTowards } from "./palm.ts";
import { createMenuDesk } from "./panels.ts";
import { yawOfAzimuth } from "./pose.ts";
import { createRing } from "./ring.ts";
import { borrowCamera, requestSession, startSession } from "./session.ts";
import { createSky } from "./sky.ts";
import { askTurn, dueTurn, newSnapTurn, readStick, vignetteOf } from "./snap.ts";
import { createStance, standpointOf } from "./stance.ts";
import {
  advance,
  beginAim,
  beginBlack,
  cancelAim,
  commit,
  newTeleport,
  phaseOf,
  releaseAim,
  shown,
  type Target,
} from "./teleport.ts";
import { createToolDesk } from "./tools.ts";
import type { HeadsetOptions, HeadsetSession } from "./types.ts";
import { createVeil } from "./veil.ts";
import { createWands } from "./wands.ts";

export { headsetSupported } from "./session.ts";
export type {
  HeadsetBookmark,
  HeadsetMark,
  HeadsetMenu,
  HeadsetOptions,
  HeadsetSession,
  HeadsetStats,
  HeadsetTool,
  HeadsetTools,
  Standpoint,
} from "./types.ts";

const DEGREE = Math.PI / 180;
/** Ground is looked for from so far above the place that was asked for: detail may lie higher than the base did. */
const GROUND_FROM_M = 1;
/** How long the ring of a refused landing is shown as invalid. */
const REFUSED_MS = 1500;

/**
 * Show the scene in the headset. To be called straight from a click.
 *
 * Rejects where there is no headset, or the user or the system says no; the page is then as it was.
 *
 * The order in a frame is fixed: head, inputs, turn, teleport, guides. Each reads the rig that the one before left, so hands,
 * arc and panels are drawn where the eyes of the same frame see them. The rig moves in a dark frame, or about the head.
 */
export async function enterHeadset(options: HeadsetOptions): Promise<HeadsetSession> {
  // (1) Ask in the task of the click: after an await the browser no longer takes it for the user's wish.
  const requested = requestSession();
  const { landings, renderer, rig, camera, scene } = options;
  const first = options.start?.() ?? standpointOf(camera);
  const granted = await requested;
  // Before the first frame: what the page's camera sees is drawn at the wrong height until the first pose is known.
  const veil = createVeil();
  veil.set(1, 0);
  scene.add(veil.object);
  const started = await startSession(renderer, granted).catch((error: unknown) => {
    scene.remove(veil.object);
    veil.dispose();
    throw error;
  });
  const { session, space } = started;

  // (2) From here on the session owns rig and camera; `onEnd` gives both back, however the session ends.
  const giveBack = borrowCamera(camera, rig);
  options.setUploadBudgetMs?.(started.profile.uploadBudgetMs);

  // (3) What is drawn besides the scene. Each of these owns its geometries and materials; `onEnd` disposes them.
  const teleport = newTeleport();
  const turn = newSnapTurn();
  const palm = newPalmHold();
  const announced: Announced = { linkLost: false };
  const sky = createSky(matchMedia("(prefers-color-scheme: dark)").matches);
  const aiming = createAiming(landings, options.radiusM);
  const waiting = createRing();
  const board = createBoard();
  const wands = createWands();
  const intervalTimes = newFrameTimes();
  const workTimes = newFrameTimes();
  const ownTimes = newFrameTimes();

  const stance = createStance(rig, started.floorM);
  // Until the first pose is known there is no head to put over the ground: nothing is pressed, aimed or landed before.
  let placed = false;
  let tracked = false;
  let aimsByStick = false;
  let maxRadiusM: number | null = null;
  // A landing above this number is the page's own, and waits for a blink of the session.
  let knownLanding = landings.status.phase === "shown" ? landings.status.landing : -1;
  let refusedUntilMs = 0;
  let active = true;
  let nowMs = performance.now();
  let startedMs = 0;
  let lastFrameMs: number | null = null;

  const groundUnder = (position: Vec3): Vec3 =>
    landings.groundAt(position[0], position[2], position[1] + GROUND_FROM_M)?.position ?? position;

  const land = (target: Target): void => {
    void landings.land(target.position, options.radiusM());
    const { landing } = landings.status;
    knownLanding = landing;
    refusedUntilMs = 0;
    commit(teleport, landing, target);
  };
  const layWaiting = (position: Vec3, normal: Vec3, turnRad: number): void => {
    waiting.lay(position, normal, stance.eye, stance.facingRad + turnRad);
  };
  const landAt = (place: Vec3, facingRad: number | null): void => {
    land({ position: place, turnRad: 0, facingRad });
    layWaiting(place, [0, 1, 0], 0);
  };
  const snap = (sign: 1 | -1): void => askTurn(turn, sign * desk.turnDeg * DEGREE, nowMs);
  const tools = createToolDesk(options, landings, {
    land: (place) => landAt(place, null),
    say: (text) => board.show(text, "warning", false, nowMs),
  });
  const desk = createMenuDesk({
    menu: options.menu,
    radiusM: options.radiusM,
    maxRadiusM: () => maxRadiusM,
    status: () => statusLine(landings.status, announced.linkLost),
    snap,
    visit: ({ place, yawDeg }) => landAt(place, yawDeg === null ? null : yawOfAzimuth(yawDeg)),
    tools: options.tools,
    openOverview: options.setMiniature === undefined ? null : () => tools.openOverview(stance.eye, stance.facingRad),
    leave: () => {
      session.end().catch(() => undefined);
    },
  });

  // (4) Inputs. One pointer aims at a time (`teleport.aimBy`); the others press and turn.
  const endAim = (by: number | null): void => {
    tools.cancel(by);
    if (cancelAim(teleport, by)) {
      aiming.hide();
      tools.hideProbe();
    }
  };
  const startAim = (pointer: Pointer, byStick: boolean): void => {
    if (beginAim(teleport, pointer.key)) {
      aimsByStick = byStick;
      if (!tools.begin()) {
        aiming.begin();
      }
    }
  };
  const letGo = (pointer: Pointer): void => {
    if (!releaseAim(teleport, pointer.key)) {
      return;
    }
    if (tools.probes) {
      tools.use(pointer, nowMs);
      return;
    }
    const aimed = aiming.aimed(pointer, nowMs);
    aiming.hide();
    if (aimed !== null) {
      land({ position: aimed.position, turnRad: aimed.turnRad, facingRad: null });
      layWaiting(aimed.position, aimed.normal, aimed.turnRad);
      pointer.source.gamepad?.hapticActuators?.[0]?.pulse(0.4, 25).catch(() => undefined);
    }
  };
  const usable = (): boolean => session.visibilityState === "visible" && placed && tracked;
  const inputs = listenInputs(
    session,
    {
      selectStart(pointer) {
        if (usable() && !desk.press(pointer) && !tools.press(pointer)) {
          startAim(pointer, false);
        }
      },
      selectEnd(pointer, completed) {
        if (completed && tools.release(pointer)) {
          return;
        }
        tools.cancel(pointer.key);
        if (teleport.aimBy === pointer.key && !aimsByStick) {
          if (completed) {
            letGo(pointer);
          } else {
            endAim(pointer.key);
          }
        }
      },
      squeeze: () => endAim(null),
      removed(pointer) {
        endAim(pointer.key);
        wands.remove(pointer);
      },
    },
    () => ({ space, rig: stance.pose }),
  );

  /** One thing before the eyes at a time: the button that opened the menu closes the overview. */
  const toggleMenu = (): void => {
    if (tools.overviewOpen) {
      tools.closeOverview();
    } else {
      desk.toggle(stance.eye, stance.facingRad);
    }
  };
  const readControls = (pointer: Pointer): void => {
    const button = inputs.pressed(pointer);
    if (button === "menu") {
      toggleMenu();
    } else if (button === "cancel") {
      endAim(null);
    }
    const push = readStick(pointer.stick, pointer.stickX, pointer.stickY);
    if (teleport.aimBy === pointer.key) {
      if (aimsByStick && pointer.stick.heldPush === "none") {
        letGo(pointer);
      }
    } else if (push === "left" || push === "right") {
      snap(push === "left" ? 1 : -1);
    } else if (push === "forward") {
      startAim(pointer, true);
    }
    const joints = pointer.source.handedness === "left" ? wands.jointsOf(pointer) : null;
    if (joints !== null && holdPalm(palm, palmTowards(joints, stance.head.position), nowMs)) {
      toggleMenu();
    }
  };

  // (5) The swap, in a frame that the veil draws black: set, rig and panels change together or not at all.
  const showLanding = (): void => {
    const { pending } = teleport;
    const { status } = landings;
    if (pending === null || status.landing !== pending.landing) {
      shown(teleport, false, false);
      return;
    }
    // The page may have swapped it before the eyes were closed; then the user alone is still to be moved.
    const isShown = status.phase === "shown";
    const report = isShown ? null : landings.swap();
    if (report === null && !isShown) {
      teleport.pending = null;
      shown(teleport, false, false);
      return;
    }
    // Moved once: when a degraded set is completed later, he stands there already and may have walked on.
    if (!pending.moved) {
      const { target } = pending;
      const towards = target.facingRad ?? stance.facingRad + target.turnRad;
      stance.stand(groundUnder(target.position), towards);
      desk.hide();
      tools.closeOverview();
      board.moved();
      options.landed?.(stance.standpoint());
      // The page was told, and may have moved the rig with its own camera: put back before this frame is drawn.
      stance.settle();
    }
    shown(teleport, true, report?.degraded ?? false);
  };
  /** A landing that the page asked for, before or beside the session, is carried out by the session's blink. */
  const adoptLanding = (): void => {
    const { status } = landings;
    if (status.landing <= knownLanding || status.phase === "idle" || status.phase === "refused") {
      return;
    }
    knownLanding = status.landing;
    commit(teleport, status.landing, { position: status.position, turnRad: 0, facingRad: null });
    layWaiting(status.position, [0, 1, 0], 0);
  };
  const step = (): void => {
    adoptLanding();
    const teleportStep = advance(teleport, nowMs, landings.status);
    if (teleportStep === "show") {
      showLanding();
    } else if (teleportStep === "refused") {
      refusedUntilMs = nowMs + REFUSED_MS;
      board.show(sentence(landings.status.refusal ?? "the landing was refused"), "warning", false, nowMs);
    }
  };
  const drawGuides = (): void => {
    const pointer = inputs.pointers.find((each) => each.key === teleport.aimBy);
    if (pointer?.hasRay === true && tools.probes) {
      tools.aim(pointer, stance.eye, nowMs);
    } else if (pointer?.hasRay === true) {
      aiming.update(pointer, stance.eye, stance.facingRad, nowMs);
    } else {
      aiming.hide();
    }
    tools.update(inputs.pointers, stance.eye, stance.standpoint().place, stance.facingRad);
    if (nowMs < refusedUntilMs) {
      waiting.show("invalid", 0);
    } else if (teleport.pending !== null && !teleport.pending.moved) {
      waiting.show("waiting", landings.status.fraction);
    } else {
      waiting.hide();
    }
    desk.update(inputs.pointers, teleport.aimBy, stance.eye, nowMs);
    board.update(stance.eye, stance.facingRad, nowMs);
    veil.set(teleport.opacity, vignetteOf(turn, nowMs));
  };
  const hideHands = (): void => {
    endAim(null);
    wands.hide();
  };
  const begin = (): void => {
    placed = true;
    beginBlack(teleport, nowMs);
    stance.stand(groundUnder(first.place), yawOfAzimuth(first.yawDeg));
  };

  // (6) Begin and end. The scene is borrowed: what was added to it is taken out again, and nothing of it is disposed.
  const onVisibility = (): void => (session.visibilityState === "visible" ? undefined : hideHands());
  const headsetObjects: readonly Object3D[] = [
    sky.object,
    veil.object,
    waiting.object,
    board.panel.object,
    ...aiming.objects,
    ...desk.objects,
    ...tools.objects,
  ];
  let resolveEnd: () => void = () => undefined;
  const ended = new Promise<void>((resolve) => {
    resolveEnd = resolve;
  });
  const onEnd = (): void => {
    active = false;
    const last = placed ? stance.standpoint() : null;
    inputs.dispose();
    scene.remove(...headsetObjects);
    rig.remove(wands.object);
    for (const each of [sky, veil, waiting, board.panel, aiming, desk, tools, wands]) {
      each.dispose();
    }
    space.removeEventListener("reset", stance.recentred);
    session.removeEventListener("visibilitychange", onVisibility);
    giveBack();
    options.setUploadBudgetMs?.(null);
    options.ended?.(last);
    resolveEnd();
  };
  space.addEventListener("reset", stance.recentred);
  session.addEventListener("visibilitychange", onVisibility);
  // After three.js's own listener, which puts the renderer's size and the camera's lens back.
  session.addEventListener("end", onEnd, { once: true });
  scene.add(...headsetObjects);
  rig.add(wands.object);

  return {
    get active() {
      return active;
    },
    get standpoint() {
      return placed ? stance.standpoint() : null;
    },
    frame(timeMs, frame) {
      // Head first: everything below reads this frame's pose, in the scene's frame.
      startedMs = performance.now();
      nowMs = timeMs;
      // Without an XR frame there is no pose to draw by: the frame loop may still run once after the end.
      if (!active || frame === undefined || frame === null) {
        return;
      }
      if (lastFrameMs !== null) {
        addTime(intervalTimes, timeMs - lastFrameMs);
      }
      lastFrameMs = timeMs;
      // None while it is taken off or tracking is lost: what is drawn stays, and no gesture goes on blindly.
      const viewer = frame.getViewerPose(space);
      if (viewer === undefined || viewer === null) {
        tracked = false;
        hideHands();
        return;
      }
      tracked = true;
      stance.read(viewer);
      if (!placed) {
        begin();
      }
      if (stance.guessBegan) {
        // Nobody lands by a guess that began in the middle of a gesture.
        endAim(null);
      }
      // Then the inputs, under the rig as it stands now; a turn below moves them only in the next frame.
      inputs.update(frame, space, stance.pose);
      if (session.visibilityState === "visible") {
        wands.update(frame, space, inputs.pointers);
        inputs.pointers.forEach(readControls);
      }
      const turnRad = dueTurn(turn, nowMs);
      if (turnRad !== 0) {
        stance.turn(turnRad);
        desk.follow(stance.eye, stance.facingRad);
        tools.follow(stance.eye, stance.facingRad);
      }
      // After the inputs, so that a release in this frame lands in it; before the guides, which show the outcome.
      step();
      drawGuides();
      addTime(ownTimes, performance.now() - startedMs);
    },
    drawn() {
      if (active && lastFrameMs !== null) {
        addTime(workTimes, performance.now() - startedMs);
      }
    },
    handle(event: StreamEvent) {
      if (event.type === "opened") {
        maxRadiusM = event.maxRadiusM;
      }
      const message = messageOf(event, announced);
      if (message !== null) {
        board.show(message.text, message.tone, message.stays, performance.now());
      }
    },
    message(text, tone) {
      board.show(text, tone, false, performance.now());
    },
    stats: () => ({
      frames: intervalTimes.count,
      frameRateHz: started.frameRateHz,
      interval: summarise(intervalTimes),
      work: summarise(workTimes),
      own: summarise(ownTimes),
      phase: phaseOf(teleport),
      casts: aiming.casts,
    }),
    end() {
      if (active) {
        session.end().catch(() => undefined);
      }
      return ended;
    },
  };
}
