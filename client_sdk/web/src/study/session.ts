/** One session: the product's viewer in a condition, with a log, live or along a recorded walk. */

import { Euler, Frustum, Matrix4, type PerspectiveCamera, Vector3 } from "three";

import { version } from "../../package.json";
import type { Shell } from "../app/shell.ts";
import { createViewer } from "../app/viewer/viewer.ts";
import type { DrawnFrame } from "../app/viewer/viewer-options.ts";
import { loadSceneInWorker, openStream, sharesOf } from "../core/index.ts";
import { defaultRadiusM } from "../core/landing-defaults.ts";
import { sceneUrlOf } from "../core/scene/urls.ts";
import { deviceBudgets } from "../three/device.ts";
import { HeadStream } from "./head-stream.ts";
import { type Head, SessionLog } from "./log.ts";
import { type HeadView, matchingErrorPx, type ScreenErrorOptions } from "./screen-error.ts";
import type { StudySettings } from "./settings.ts";
import { parseWalk, poseAt } from "./walk.ts";

/** What is declared and does not come (its payload was let go meanwhile) is given up. */
const MAX_WAIT_FRAMES = 120;

/** A running session. */
export interface StudySession {
  readonly settings: StudySettings;
  readonly log: SessionLog;
  /** Milliseconds since the session began: of the walk's own clock along a recorded one. */
  nowMs(): number;
  /** Walk a recorded walk, so many frames for each second of it; resolves with the log. */
  play(walk: unknown, framesPerS: number): Promise<object>;
  /** Log no more. */
  stop(): void;
}

/** Load the scene, open a viewer in the condition, and begin the log. */
export async function openSession(shell: Shell, settings: StudySettings, root: HTMLElement): Promise<StudySession> {
  const sceneUrl = sceneUrlOf(shell.serverUrl, settings.scene);
  const { token } = shell.token;
  const access = token === undefined ? {} : { token };
  const files = await loadSceneInWorker(sceneUrl, access);
  const ofDevice = deviceBudgets();
  const radiusM = settings.radiusM ?? defaultRadiusM(files.manifest, ofDevice);
  const budgets = { ...ofDevice, radiusM };
  // Nothing is kept on disk: a participant's second session must not have what the first one loaded.
  const inner = openStream({
    sceneUrl,
    ...access,
    budgets: sharesOf(budgets, files).budgets,
    cacheBytes: budgets.cacheBytes,
    diskBytes: 0,
    creditBytes: budgets.creditBytes,
  });
  const follower = new HeadStream(inner);
  const isFollowing = settings.condition === "head";
  const { manifest } = files;

  const startMs = performance.now();
  /** Time of the walk, where one is played. */
  let walkMs: number | null = null;
  let isStopped = false;
  let lastFrameMs = startMs;
  let log: SessionLog | null = null;
  const nowMs = (): number => walkMs ?? performance.now() - startMs;
  const newLog = (view: HeadView, walk: "live" | "recorded"): SessionLog =>
    new SessionLog({
      condition: settings.condition,
      scene: manifest.id,
      sceneVersion: manifest.version,
      viewer: version,
      participant: settings.participant,
      order: settings.order,
      radiusM,
      maxErrorPx: isFollowing ? errorOptions(view).maxErrorPx : null,
      walk,
      started: new Date(performance.timeOrigin + startMs).toISOString(),
      device: navigator.userAgent,
    });
  const errorOptions = (view: HeadView): ScreenErrorOptions => ({
    baseErrorM: manifest.deviationM,
    maxErrorPx: settings.maxErrorPx ?? matchingErrorPx(view.pixelsPerMetre, manifest.deviationM, radiusM),
    budgets,
  });

  let landingShown = 0;
  /** Frames since a set was declared that is not drawn yet; null: none is. */
  let waitedFrames: number | null = null;
  let walkKind: "live" | "recorded" = "live";

  function eachFrame({ stage, camera, heightPx }: DrawnFrame): void {
    const view = viewOf(camera, heightPx);
    log ??= newLog(view, walkKind);
    const { status } = stage;
    if (status.phase === "shown") landingShown = status.landing;
    const isShown = status.landing > 0 && landingShown === status.landing;
    if (isFollowing && isShown) {
      // The first swap of a landing was the viewer's own, in the dark; these are not.
      if (waitedFrames !== null && status.phase === "presentable") stage.swap();
      waitedFrames = stage.status.phase === "shown" || waitedFrames === null ? null : waitedFrames + 1;
      if (waitedFrames === null || waitedFrames > MAX_WAIT_FRAMES)
        waitedFrames = follower.follow(view, stage.shownSegments, errorOptions(view)) ? 0 : waitedFrames;
    } else {
      waitedFrames = null;
    }
    const timeMs = performance.now();
    if (!isStopped) {
      const { landing, position, radiusM: landedRadiusM } = status;
      const now = { landing, isShown, position, radiusM: landedRadiusM };
      const factsOf = (segment: number) => follower.factsOf(segment);
      log.frame(nowMs(), timeMs - lastFrameMs, headOf(camera), view, stage.shownSegments, now, factsOf);
    }
    lastFrameMs = timeMs;
  }

  const viewer = createViewer({
    shell,
    sceneUrl,
    files,
    stream: follower,
    budgets,
    route: settings.route,
    reload: () => window.location.reload(),
    loadFiles: (wanted) => loadSceneInWorker(sceneUrl, { ...access, version: wanted }),
    eachFrame,
  });
  root.replaceChildren(viewer.element);
  viewer.start();
  const terraport = window.terraport!;
  // The log begins with the first frame.
  await terraport.look(null);

  return {
    settings,
    get log() {
      return log!;
    },
    nowMs,
    stop() {
      isStopped = true;
    },
    async play(walk, framesPerS) {
      const legs = parseWalk(walk);
      walkKind = "recorded";
      walkMs = 0;
      log = null;
      for (const leg of legs) {
        // Where the landing puts the eye; whoever waits for it does not move.
        await terraport.look(leg.poses[0]!);
        await terraport.land(leg.position, leg.radiusM);
        for (let frame = 0; ; frame += 1) {
          const pose = poseAt(leg, leg.tS[0]! + frame / framesPerS);
          if (pose === null) break;
          walkMs += 1000 / framesPerS;
          await terraport.look(pose);
        }
      }
      isStopped = true;
      return log!.toJson();
    },
  };
}

const matrix = new Matrix4();
const frustum = new Frustum();
const vector = new Vector3();
const euler = new Euler();

/** What the camera sees; of a headset the camera of both eyes together. */
function viewOf(camera: PerspectiveCamera, heightPx: number): HeadView {
  camera.updateWorldMatrix(true, false);
  matrix.multiplyMatrices(camera.projectionMatrix, matrix.copy(camera.matrixWorld).invert());
  frustum.setFromProjectionMatrix(matrix);
  const { x, y, z } = vector.setFromMatrixPosition(camera.matrixWorld);
  return {
    eye: [x, y, z],
    planes: frustum.planes.map(({ normal, constant }) => ({
      normal: [normal.x, normal.y, normal.z],
      offset: constant,
    })),
    // The projection's second diagonal element is the cotangent of half the opening.
    pixelsPerMetre: (heightPx / 2) * camera.projectionMatrix.elements[5],
  };
}

function headOf(camera: PerspectiveCamera): Head {
  const { x, y, z } = vector.setFromMatrixPosition(camera.matrixWorld);
  euler.setFromRotationMatrix(camera.matrixWorld, "YXZ");
  const degrees = 180 / Math.PI;
  return {
    position: [x, y, z],
    // A compass azimuth, as the address has it.
    yawDeg: -euler.y * degrees,
    pitchDeg: euler.x * degrees,
    rollDeg: euler.z * degrees,
  };
}
