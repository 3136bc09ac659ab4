/**
 * Clicks anywhere on a real scene, by the page's own tools, going and camera: where the eye is after the landing.
 *
 * As `server.test.ts`; `TERRAPORT_CLICKS` is how many (200 without it).
 */

import { afterAll, describe, expect, test, vi } from "vitest";
import { createStore } from "../../src/app/store.ts";
import { createCameraDesk, type Ray } from "../../src/app/viewer/camera-desk.ts";
import { createGoing, type GoingOptions } from "../../src/app/viewer/going.ts";
import { createGroundTools } from "../../src/app/viewer/ground-tools.ts";
import type { LandingOrder } from "../../src/app/viewer/landing-desk.ts";
import type { ViewerState } from "../../src/app/viewer/state.ts";
import { EYE_HEIGHT_M } from "../../src/app/walk-pose.ts";
import { budgetsFor } from "../../src/core/budgets.ts";
import { defaultRadiusM } from "../../src/core/landing-defaults.ts";
import { loadScene } from "../../src/core/scene/load.ts";
import { sceneUrlOf } from "../../src/core/scene/urls.ts";
import type { MeshData, SceneFiles, Vec3 } from "../../src/core/types.ts";
import { FaceBoxes } from "../../src/three/face-boxes.ts";
import { isBuried, standNear } from "../../src/three/footing.ts";
import { castGround, groundOnVertical, type Pickable, type ShownGround } from "../../src/three/ground-picking.ts";
import { seeded } from "../seeded.ts";
import { listening } from "./listening.ts";

const { TERRAPORT_URL, TERRAPORT_SCENE = "sample" } = process.env;
const CLICKS = Number(process.env.TERRAPORT_CLICKS ?? 200);

const SIZE = { width: 1280, height: 720 };

/** Every segment of the scene, through one landing over all of it. */
async function everySegment(sceneUrl: string, files: SceneFiles): Promise<Pickable[]> {
  const { stream, ready } = listening({ sceneUrl });
  const { bounds } = files.manifest;
  const middle: Vec3 = [0, 1, 2].map((axis) => (bounds[axis]! + bounds[axis + 3]!) / 2) as unknown as Vec3;
  const { visible } = await ready(stream.land(middle, Math.hypot(bounds[3] - bounds[0], bounds[5] - bounds[2])));
  expect(visible).toHaveLength(files.manifest.segmentCount);
  const meshes = await Promise.all(visible.map((key) => stream.mesh(key, files.manifest.attributes)));
  stream.close();
  return meshes.map((mesh, segment) => ({ segment, bounds: mesh.bounds, boxes: new FaceBoxes(mesh) }));
}

/** A scene that is clicked on: `shown` is what the page has at the moment. */
function clickable(files: SceneFiles, segments: readonly Pickable[]) {
  const { manifest } = files;
  const base: Pickable = { segment: -1, bounds: files.base.bounds, boxes: new FaceBoxes(files.base) };
  const pushM = manifest.deviationM;
  const bare: ShownGround = { segments: [], base, hidden: undefined, pushM };
  const whole: ShownGround = { segments, base: null, hidden: undefined, pushM: 0 };
  let shown = bare;
  const ground = {
    cast: (origin: Vec3, direction: Vec3, maxM: number) => castGround(shown, origin, direction, maxM),
    groundAt: (x: number, z: number, fromY: number) => groundOnVertical(shown, x, z, fromY),
  };
  const truth = {
    cast: (origin: Vec3, direction: Vec3, maxM: number) => castGround(whole, origin, direction, maxM),
  };
  return {
    ground,
    truth,
    showBase() {
      shown = bare;
    },
    /** What a landing shows: the segments within the radius, and the base without the faces that they cover. */
    showLanding(at: Vec3, radiusM: number) {
      const near = segments.filter(({ bounds }) => {
        const beyond = [0, 1, 2].map((axis) => Math.max(bounds[axis]! - at[axis]!, 0, at[axis]! - bounds[axis + 3]!));
        return Math.hypot(...beyond) <= radiusM;
      });
      const hidden = facesUnder(files.base, near);
      shown = { segments: near, base, hidden, pushM };
    },
  };
}

/** Faces of the base of which every corner is in the box of one of these. The service hides no others, and a few less. */
function facesUnder(base: MeshData, near: readonly Pickable[]): Uint8Array {
  const { positions, translation, stepM, indices, faceCount } = base;
  const stride = positions instanceof Uint16Array ? 4 : 3;
  const isUnder = (vertex: number) => {
    const [x, z] = [0, 2].map((axis) => translation[axis]! + stepM * positions[stride * vertex + axis]!);
    return near.some(({ bounds: b }) => x! >= b[0]! && x! <= b[3]! && z! >= b[2]! && z! <= b[5]!);
  };
  const hidden = new Uint8Array(Math.ceil(faceCount / 8));
  for (let face = 0; face < faceCount; face += 1) {
    if ([0, 1, 2].every((corner) => isUnder(indices[3 * face + corner]!))) hidden[face >> 3]! |= 1 << (face & 7);
  }
  return hidden;
}

const nothing = () => {};

describe.skipIf(TERRAPORT_URL === undefined)("clicks on a real scene", () => {
  vi.stubGlobal("window", { matchMedia: () => ({ matches: true }), setTimeout });
  afterAll(() => vi.unstubAllGlobals());

  test(`${CLICKS} of them leave no eye in the rock`, async () => {
    const sceneUrl = sceneUrlOf(TERRAPORT_URL!, TERRAPORT_SCENE);
    const files = await loadScene(sceneUrl);
    const scene = clickable(files, await everySegment(sceneUrl, files));
    const { bounds } = files.manifest;
    const radiusM = defaultRadiusM(files.manifest, budgetsFor("desktop"));
    const random = seeded(24);
    const between = (from: number, to: number) => from + ((to - from) * random(2 ** 30)) / 2 ** 30;
    const counts = { walked: 0, above: 0, nothing: 0, buried: 0 };
    const buried: { order: LandingOrder; eye: Vec3 }[] = [];

    for (let click = 0; click < CLICKS; click += 1) {
      scene.showBase();
      const store = createStore({
        manifest: files.manifest,
        view: "orbit",
        tool: "land",
        aim: null,
        landed: null,
        bringsCamera: true,
      } as unknown as ViewerState);
      const parts = {
        rotation: { set: nothing },
        position: { set: nothing },
        updateMatrixWorld: nothing,
        updateProjectionMatrix: nothing,
      };
      const height = (x: number, z: number, fromY: number) => scene.ground.groundAt(x, z, fromY)?.position[1] ?? null;
      const lens = { ...parts, fov: 55, aspect: SIZE.width / SIZE.height } as never;
      const camera = createCameraDesk(parts as never, lens, bounds, height);
      const look = {
        view: "orbit",
        yawDeg: between(0, 360),
        pitchDeg: between(-80, -5),
        distanceM: between(0.2, 1.3) * camera.look.distanceM!,
        focus: [between(bounds[0], bounds[3]), between(bounds[1], bounds[4]), between(bounds[2], bounds[5])],
      } as const;
      camera.moveTo(look.focus, look, false);
      const ray: Ray = { origin: camera.eye, direction: direction(look, between(-1, 1), between(-1, 1)) };
      // An eye that was in the rock before the click says nothing of the click.
      if (isBuried(ray.origin, scene.truth) && scene.truth.cast(ray.origin, [0, 1, 0], 1e6) !== null) {
        click -= 1;
        continue;
      }
      let refused: string | null = null;
      const orders: LandingOrder[] = [];
      const going = createGoing({
        store,
        stage: { markFresh: nothing, status: { phase: "idle" }, cast: scene.ground.cast },
        camera,
        notices: { clear: nothing, show: nothing },
        link: { follow: nothing },
        loop: { request: nothing },
        order: (order: LandingOrder) => orders.push(order),
        stand: (at: Vec3) => standNear({ position: at, normal: [0, 1, 0] }, scene.ground),
        isBuried: ([x, y, z]: Vec3) => isBuried([x, y + EYE_HEIGHT_M, z], scene.ground),
      } as unknown as GoingOptions);
      const tools = createGroundTools({
        store,
        stream: { pick: () => Promise.resolve(null) },
        rayAt: () => ray,
        cast: ({ origin, direction: along }) => scene.ground.cast(origin, along, 1e4),
        standNear: (hit) => standNear(hit, scene.ground),
        pixelOf: () => null,
        aim: nothing,
        cancelAim: () => store.set({ aim: null }),
        land: (position) => going.land({ position, radiusM, look: null, isEntry: true, goes: true }),
        announce: nothing,
        refuse: (reason) => {
          refused = reason ?? refused;
        },
      });
      tools.tap(0, 0);
      const [order] = orders;
      if (order === undefined) {
        expect(refused).toBe("nothing");
        counts.nothing += 1;
        continue;
      }
      scene.showLanding(order.position, order.radiusM);
      going.arrived(order);
      if (camera.view === "walk") counts.walked += 1;
      else counts.above += 1;
      if (camera.view === "walk" && isBuried(camera.eye, scene.truth)) {
        counts.buried += 1;
        buried.push({ order, eye: camera.eye });
      }
    }
    process.stdout.write(`${JSON.stringify(counts)} ${JSON.stringify(buried.slice(0, 5))}\n`);
    expect(counts.walked).toBeGreaterThan(CLICKS / 4);
    expect(counts.buried).toBe(0);
  }, 1_800_000);
});

/** Through the pixel at (x, y) of the picture, from -1 to 1. */
function direction(look: { readonly yawDeg: number; readonly pitchDeg: number }, x: number, y: number): Vec3 {
  const [yaw, pitch] = [(look.yawDeg * Math.PI) / 180, (look.pitchDeg * Math.PI) / 180];
  const half = Math.tan((55 * Math.PI) / 360);
  const forward: Vec3 = [Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), -Math.cos(yaw) * Math.cos(pitch)];
  const right: Vec3 = [Math.cos(yaw), 0, Math.sin(yaw)];
  const up: Vec3 = [-Math.sin(yaw) * Math.sin(pitch), Math.cos(pitch), Math.cos(yaw) * Math.sin(pitch)];
  const across = (x * half * SIZE.width) / SIZE.height;
  const along = [0, 1, 2].map((axis) => forward[axis]! + right[axis]! * across + up[axis]! * y * half);
  const length = Math.hypot(...along);
  return [along[0]! / length, along[1]! / length, along[2]! / length];
}
