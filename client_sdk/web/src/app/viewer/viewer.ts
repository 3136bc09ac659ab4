/** The viewer of one scene: makes its modules, gives each what it needs, and draws. */

import { listScenes } from "../../core/scene/load.ts";
import type { SceneFiles, Vec3 } from "../../core/types.ts";

import { isBuried, standNear, Terrain } from "../../three/index.ts";
import { farthest } from "../../three/orbit-pose.ts";
import { isTouch, prefersLessMotion } from "../device.ts";
import { h, setAttribute } from "../dom.ts";
import { nothingNotice, steepNotice } from "../failures.ts";
import { createFrameTimes } from "../frame-times.ts";
import { asAddressed, parseRoute, type Route } from "../route.ts";
import { saveFile } from "../save-file.ts";
import { createStore } from "../store.ts";
import { EYE_HEIGHT_M, type WalkInput } from "../walk-pose.ts";
import { createActions } from "./actions.ts";
import { createBars } from "./bars.ts";
import { createBlink } from "./blink.ts";
import { createBrush } from "./brush.ts";
import { createBrushLines } from "./brush-lines.ts";
import { watchBuilding } from "./building-watch.ts";
import { createCameraDesk, type Ray } from "./camera-desk.ts";
import { watchComfort } from "./comfort.ts";
import { createCompareView } from "./compare.ts";
import { createEmbedListeners } from "./embed.ts";
import { createEmbed } from "./embed-object.ts";
import { createFrameLoop, type FrameResult } from "./frame-loop.ts";
import { listenToGestures } from "./gestures.ts";
import { createGoing } from "./going.ts";
import { createGroundTools } from "./ground-tools.ts";
import { createGroupDesk } from "./group-desk.ts";
import { createHeadsetEntry } from "./headset-entry.ts";
import { headsetOptions } from "./headset-options.ts";
import { createHelpDialog } from "./help-dialog.ts";
import { createHints } from "./hints.ts";
import { listenToKeys } from "./keys.ts";
import { createLabels } from "./labels.ts";
import { createLandingDesk } from "./landing-desk.ts";
import { createMarkers } from "./markers.ts";
import { createNotices } from "./notices.ts";
import { createPlaceLink } from "./place-link.ts";
import { reactToState } from "./react.ts";
import { firstState } from "./route-state.ts";
import type { ViewerState } from "./state.ts";
import { watchStream } from "./stream-watch.ts";
import type { ViewerOptions } from "./viewer-options.ts";
import { createViewerPanel } from "./viewer-panel.ts";
import { createWalkPad } from "./walk-pad.ts";
import { createWorld } from "./world.ts";

/** An open viewer. */
export interface Viewer {
  readonly element: HTMLElement;
  /** The address of what is shown. */
  readonly route: Route;
  /** Go where the address says. To be called once `element` is in the page. */
  start(): void;
  /** Base and cover are here, where it was made of the overview. False where they belong to another version. */
  complete(files: SceneFiles): boolean;
  follow(route: Route): void;
  dispose(): void;
}

/** How long frames go on after the last thing that may need one: a message from the stream, a move. */
const LINGER_MS = 250;
/** So long a click that met no ground is explained. */
const REFUSAL_MS = 5000;
/** The figures are read so often while they are shown. */
const FIGURES_MS = 500;

/**
 * Make a viewer. Throws where the browser has no WebGL 2; the stream is the caller's to close then.
 *
 * Modules know each other through the options here alone, and the store holds what they share. Those that need one which is
 * made later are given a function: it must not be called before this function has returned.
 */
export function createViewer(options: ViewerOptions): Viewer {
  const { shell, files, stream, loadFiles, reload } = options;
  const { manifest } = files;
  const store = createStore<ViewerState>(firstState(options));
  const times = createFrameTimes();
  const listeners = createEmbedListeners();
  const abort = new AbortController();

  // --- What is drawn ------------------------------------------------------------------------------------------------

  const view = h("div", { class: "view" });
  const world = createWorld(view, manifest.name, {
    resized(width, height) {
      camera.resize(width, height);
      markers.resize(width, height);
      brushLines.resize(width, height);
      // The canvas is empty until something is drawn.
      draw();
      loop.request();
    },
  });
  const { budgets } = options;
  const stage = new Terrain({ renderer: world.renderer, stream, files, budgets, autoSwap: false });
  stage.addEventListener("contextlost", contextLost);
  stage.addEventListener("contextrestored", contextRestored);
  const markers = createMarkers();
  const brushLines = createBrushLines();
  world.scene.add(stage, markers.object, brushLines.object);
  const labels = createLabels();
  const blink = createBlink();

  const maxDistanceM = farthest(manifest.bounds) * 2;
  /** The ground along a ray, as far as anything is shown. */
  const cast = ({ origin, direction }: Ray) => stage.cast(origin, direction, maxDistanceM);
  const groundHeight = (x: number, z: number, fromY: number) => stage.groundAt(x, z, fromY)?.position[1] ?? null;
  /** Where to stand at a place, or near it; null where nobody could. */
  const stand = (at: Vec3) => standNear({ position: at, normal: [0, 1, 0] }, stage);
  /** The highest ground at (x, z). */
  const highest = (x: number, z: number) => groundHeight(x, z, manifest.bounds[4] + 1);
  const camera = createCameraDesk(world.rig, world.camera, manifest.bounds, groundHeight);

  // --- Who does what ------------------------------------------------------------------------------------------------

  const comfort = watchComfort(stage, store, (report) => listeners.emit("swap", report));
  const notices = createNotices(shell.announcer, (remedy, key) => actions.applyRemedy(remedy, key));
  const building = watchBuilding({
    sceneId: options.route.scene ?? "",
    notices,
    list: (signal) => listScenes(shell.serverUrl, { token: shell.token.token, signal }),
  });
  const headset = createHeadsetEntry(() => bars.showHeadset(true));
  const loop = createFrameLoop(world.renderer, times, frame);
  const link = createPlaceLink();
  const going = createGoing({
    store,
    stage,
    camera,
    markers,
    notices,
    link,
    loop,
    announcer: shell.announcer,
    order: (order, landOptions) => desk.land(order, landOptions),
    stand,
    isBuried: ([x, y, z]) => isBuried([x, y + EYE_HEIGHT_M, z], stage),
  });
  const desk = createLandingDesk({
    store,
    stage,
    unseen(swap) {
      // Who stands on the ground closes his eyes; from above, a change of what lies below does no harm.
      if (camera.view === "walk") blink.start(swap, prefersLessMotion());
      else swap();
    },
    arrived: going.arrived,
    shown: going.shown,
  });
  const group = createGroupDesk({
    store,
    stream,
    announcer: shell.announcer,
    land(position, radiusM) {
      void going.land({ position, radiusM, look: null, isEntry: true, goes: true });
      return stage.status.landing;
    },
  });
  const watch = watchStream({
    store,
    stream,
    stage,
    desk,
    headset,
    comfort,
    notices,
    listeners,
    loop,
    shell,
    loadFiles,
    reload,
  });
  // Set in the task in which the stream was made, as `Stream.onEvent` asks: no event is lost.
  let lastEventMs = 0;
  stream.onEvent = (event) => {
    lastEventMs = performance.now();
    watch(event);
    group.handle(event);
  };
  let refusalTimer: number | null = null;
  const tools = createGroundTools({
    store,
    stream,
    rayAt: camera.rayAt,
    cast,
    standNear: (hit) => standNear(hit, stage),
    pixelOf: camera.pixelOf,
    aim: (position) => desk.aim(asAddressed(position), store.get().radiusM),
    cancelAim: () => desk.cancelAim(),
    land(place) {
      const position = asAddressed(place);
      going.land({ position, radiusM: store.get().radiusM, look: null, isEntry: true, goes: true });
    },
    announce: shell.announcer.announce,
    refuse(reason) {
      if (refusalTimer !== null) window.clearTimeout(refusalTimer);
      refusalTimer = null;
      if (reason === null) {
        notices.clear("ground");
        return;
      }
      notices.show(reason === "steep" ? steepNotice(true) : nothingNotice());
      // It may lie over the ground that is clicked next.
      refusalTimer = window.setTimeout(() => notices.clear("ground"), REFUSAL_MS);
    },
  });
  const brush =
    manifest.mayPaint === true
      ? createBrush({
          store,
          sceneUrl: options.sceneUrl,
          lines: brushLines,
          http: () => ({ token: shell.token.token }),
          rayAt: camera.rayAt,
          cast,
          highest,
          setTaught: (picture) => stage.setTaught(picture),
          lookAt: (place) => moving(() => camera.moveTo(place, null, true)),
          announce: shell.announcer.announce,
          changed: () => loop.request(),
        })
      : null;
  const help = createHelpDialog();
  const { routeNow } = going;
  const { regions } = files;
  const keptPlaces = () => panel.keptPlaces();
  const actions = createActions({
    store,
    stream,
    shell,
    camera,
    desk,
    markers,
    notices,
    loop,
    headset,
    going,
    tools,
    canvas: world.canvas,
    headsetOptions: () =>
      headsetOptions({
        store,
        world,
        stage,
        camera,
        markers,
        loop,
        link,
        routeNow,
        keptPlaces,
        tools,
        regions,
      }),
    reload,
    panel: () => panel,
    brush: () => brush,
    openHelp: help.open,
    usesKeys: () => setAttribute(element, "data-keys", true),
  });

  // --- What is on the page ------------------------------------------------------------------------------------------

  const compare = createCompareView(store, () => actions.act("compare"));
  const hints = options.guides === true ? createHints(store, shell.storage, shell.announcer, isTouch()) : null;
  const pad = createWalkPad(() => loop.request());
  const bars = createBars({
    store,
    name: manifest.name,
    themeButton: shell.theme.button(),
    act: actions.act,
    enterHeadset: () => void actions.enterHeadset(),
  });
  const panel = createViewerPanel({
    store,
    stage,
    files,
    shell,
    frames: times.recent,
    copy: (text, subject) => void actions.copy(text, subject),
    landAim: going.landAim,
    cancelAim: desk.cancelAim,
    aimAtCentre: () => actions.act("aim"),
    undoPoint: tools.undoPoint,
    heightAt: highest,
    group,
    savePicture: () => {
      world.picture(labels.paint).then(
        (picture) => saveFile(picture, `${manifest.id}.jpg`),
        (error: unknown) => panel.flash(`No picture: ${error instanceof Error ? error.message : "try again"}`),
      );
    },
    go: (hash) => going.follow(parseRoute(hash), true),
    routeNow,
    diagnostics: () => embed.diagnostics(),
  });
  view.append(
    labels.element,
    h("div", { class: "crosshair", "aria-hidden": "true" }),
    blink.element,
    compare.line,
    bars.top,
    notices.element,
    pad.element,
    compare.card,
    hints?.element ?? "",
    brush?.card ?? "",
    bars.tools,
    h(
      "p",
      { id: "view-help", class: "visually-hidden" },
      "Drag or use the arrow keys to look around. Enter lands at the middle of the picture, Space aims there first. Question mark tells all keys.",
    ),
  );
  const element = h("main", { id: "viewer", class: "viewer" }, view, panel.element, help.element);
  const embed = createEmbed({
    store,
    regions,
    stage,
    world,
    camera,
    desk,
    going,
    notices,
    headset,
    listeners,
    loop,
    cast,
    frameTimes: times.recent,
    nextFrame,
  });
  window.terraport = embed;

  function showState(state: ViewerState): void {
    setAttribute(element, "data-view", state.view);
    setAttribute(element, "data-tool", state.tool);
    setAttribute(element, "data-panel", state.panelOpen ? "open" : "closed");
  }
  showState(store.get());

  // --- Who listens --------------------------------------------------------------------------------------------------

  const moving = (move: () => void) => {
    move();
    going.moved();
    hints?.looked();
  };
  const stops = [
    reactToState({
      store,
      stage,
      camera,
      desk,
      markers,
      labels,
      notices,
      link,
      listeners,
      loop,
      theme: shell.theme,
      settledRoute: going.settledRoute,
    }),
    store.subscribe(showState),
    shell.theme.subscribe((theme) => {
      stage.setMode(store.get().mode, theme);
      loop.request();
    }),
    listenToGestures(world.canvas, {
      drag: (dx, dy) => moving(() => camera.drag(dx, dy)),
      pan: (dx, dy) => moving(() => camera.pan(dx, dy)),
      twist: (degrees) => moving(() => camera.twist(degrees)),
      zoom: (factor, x, y) => moving(() => camera.zoom(factor, cast(camera.rayAt(x, y))?.position ?? null)),
      tap: tools.tap,
      press: tools.press,
      pressEnd: tools.pressEnd,
      paint: (x, y) => brush?.press(x, y) ?? false,
      paintMove: (x, y) => brush?.move(x, y),
      paintEnd: (cancelled) => brush?.end(cancelled),
    }),
  ];
  const keys = listenToKeys(world.canvas, actions.act, () => {
    setAttribute(element, "data-keys", true);
    loop.request();
  });
  world.canvas.addEventListener("pointerdown", () => setAttribute(element, "data-keys", null), {
    signal: abort.signal,
  });
  const figures = window.setInterval(panel.refresh, FIGURES_MS);

  // --- Frames -------------------------------------------------------------------------------------------------------

  let waitingForFrame: (() => void)[] = [];

  function nextFrame(): Promise<void> {
    return new Promise((resolve) => {
      waitingForFrame.push(resolve);
      loop.request();
    });
  }

  function walkInput(): WalkInput {
    const input = keys.input(camera.view === "walk");
    return {
      ...input,
      forward: Math.max(-1, Math.min(1, input.forward + pad.forward)),
      right: Math.max(-1, Math.min(1, input.right + pad.right)),
      fast: input.fast || pad.fast,
    };
  }

  function frame(timeMs: number, dtS: number, xrFrame: XRFrame | null): FrameResult {
    const { session } = headset;
    let isBusy = false;
    if (session !== null) {
      session.frame(timeMs, xrFrame ?? undefined);
    } else {
      const [input, zoom] = [walkInput(), keys.zoom()];
      if (camera.update(timeMs, dtS, input, zoom)) {
        isBusy = true;
        going.moved();
      }
      if (input.forward || input.right || input.turn || input.nod || zoom) hints?.looked();
    }
    // In a headset too: uploads go on, within its smaller budget.
    stage.update();
    if (session === null) {
      // After the camera and the stage: what is ready now is drawn in this very frame, from where the eye is now.
      if (desk.update()) isBusy = true;
      blink.update(timeMs);
    }
    options.eachFrame?.({ stage, camera: world.eye, heightPx: world.heightPx });
    // After everything that could change what is visible, or it would not see it.
    comfort.check();
    if (markers.step(highest)) isBusy = true;
    draw();
    session?.drawn();
    const lingers = performance.now() - lastEventMs < LINGER_MS;
    return isBusy || blink.isRunning || stage.busy || lingers ? "again" : "rest";
  }

  function draw(): void {
    if (!store.get().contextLost) world.render();
    if (headset.session === null) labels.update(camera.pixelOf);
    const waiting = waitingForFrame;
    waitingForFrame = [];
    for (const resolve of waiting) resolve();
  }

  function contextLost(): void {
    store.set({ contextLost: true });
    notices.show({
      key: "graphics",
      tone: "warning",
      title: "The graphics device was reset",
      text: "The picture comes back as soon as the browser gives it back. If it stays empty, reload the page.",
      remedies: ["reload-page"],
    });
  }

  function contextRestored(): void {
    store.set({ contextLost: false });
    notices.clear("graphics");
    shell.announcer.announce("The picture is back");
    loop.request();
  }

  return {
    element,
    get route() {
      return routeNow();
    },
    start() {
      stage.setMode(store.get().mode, shell.theme.theme);
      world.prepare();
      going.follow(options.route, false);
      loop.request();
    },
    complete(whole) {
      if (whole.manifest.version !== manifest.version) return false;
      stage.replaceFiles(whole);
      loop.request();
      return true;
    },
    follow: (route) => going.follow(route, false),
    dispose() {
      // Listeners first, then the stream, then what is drawn: nothing may reach a stage that is freed.
      window.terraport = undefined;
      abort.abort();
      headset.end();
      window.clearInterval(figures);
      for (const stop of stops) stop();
      keys.dispose();
      link.dispose();
      building.dispose();
      compare.dispose();
      group.dispose();
      hints?.dispose();
      brush?.dispose();
      notices.dispose();
      loop.stop();
      stream.close();
      stage.dispose();
      markers.dispose();
      world.dispose();
    },
  };
}
