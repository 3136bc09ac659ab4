/** Canvas, renderer, camera and rig: what is drawn with, apart from what is drawn. */

import { Group, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { h } from "../dom.ts";

/** Owns canvas, WebGL context and renderer; whoever adds objects to `scene` takes them out and frees them. */
export interface World {
  readonly canvas: HTMLCanvasElement;
  readonly renderer: WebGLRenderer;
  readonly scene: Scene;
  /** Carries the camera; a headset moves it. */
  readonly rig: Group;
  readonly camera: PerspectiveCamera;
  /** The camera of what is drawn: in a headset that of both eyes together. */
  readonly eye: PerspectiveCamera;
  /** Height of an eye's picture, pixels of the device. */
  readonly heightPx: number;
  /** Make the programs of what is in the scene now, so that no frame has to wait for them when it first shows it. */
  prepare(): void;
  render(): void;
  /** What is shown, as JPEG, over the page's sky; `paint` draws over it, at so many of its pixels per CSS pixel. */
  picture(paint: (context: CanvasRenderingContext2D, scale: number) => void): Promise<Blob>;
  dispose(): void;
}

/** Called by the browser's events, outside the frame loop. */
export interface WorldEvents {
  /** The canvas has another size, CSS pixels. Draw at once: an empty canvas would flash. */
  resized(width: number, height: number): void;
}

/** Sharper than this nobody sees, and it costs by the square. */
const MAX_PIXEL_RATIO = 2;
const FOV_DEG = 55;
/** Where the sky's lower colour is reached, as the page's style has it. */
const SKY_SHARE = 0.7;
const JPEG_QUALITY = 0.92;

/**
 * Make canvas, renderer and an empty scene. Throws where the browser has no WebGL 2.
 *
 * The scene graph is one level deep: the rig with the camera, and whatever the viewer adds, all in the scene's frame.
 */
export function createWorld(container: HTMLElement, name: string, events: WorldEvents): World {
  const canvas = h("canvas", {
    id: "view",
    tabindex: 0,
    role: "application",
    "aria-label": `Ground of ${name}`,
    "aria-roledescription": "3D view",
    "aria-describedby": "view-help",
  });
  const renderer = new WebGLRenderer({ canvas, alpha: true, antialias: true, powerPreference: "high-performance" });
  // The sky is the page's: it shows where nothing is drawn.
  renderer.setClearColor(0x000000, 0);
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
  renderer.xr.enabled = true;
  container.prepend(canvas);

  const scene = new Scene();
  const rig = new Group();
  const camera = new PerspectiveCamera(FOV_DEG, 1, 0.1, 4000);
  rig.add(camera);
  scene.add(rig);

  const abort = new AbortController();
  const observer = new ResizeObserver(() => {
    // A headset has a size of its own, which three.js keeps while it presents.
    const { clientWidth: width, clientHeight: height } = container;
    if (width === 0 || height === 0 || renderer.xr.isPresenting) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
    renderer.setSize(width, height, false);
    events.resized(width, height);
  });
  observer.observe(container);

  return {
    canvas,
    renderer,
    scene,
    rig,
    camera,
    get eye() {
      return renderer.xr.isPresenting ? renderer.xr.getCamera() : camera;
    },
    get heightPx() {
      const ofEye = renderer.xr.isPresenting ? renderer.xr.getCamera().cameras[0]?.viewport : undefined;
      return ofEye?.w ?? canvas.height;
    },
    prepare() {
      // Beside, where the browser can; else here, where the page is loading anyway.
      if (renderer.extensions.has("KHR_parallel_shader_compile")) {
        renderer.compileAsync(scene, camera).catch(() => undefined);
      } else {
        renderer.compile(scene, camera);
        // A program that is only begun would be waited for where it is first drawn: in a landing.
        for (const program of renderer.info.programs ?? []) {
          program.getUniforms();
        }
      }
    },
    render() {
      renderer.render(scene, camera);
    },
    picture(paint) {
      const sheet = document.createElement("canvas");
      sheet.width = canvas.width;
      sheet.height = canvas.height;
      const context = sheet.getContext("2d");
      if (context === null) return Promise.reject(new Error("the browser gives no canvas to copy the picture to"));
      // The computed gradient: its colours are those of the page's light or dark look.
      const [top, bottom] = getComputedStyle(container).backgroundImage.match(/rgba?\([^)]*\)/g) ?? [];
      const sky = context.createLinearGradient(0, 0, 0, SKY_SHARE * sheet.height);
      sky.addColorStop(0, top ?? "white");
      sky.addColorStop(1, bottom ?? "white");
      context.fillStyle = sky;
      context.fillRect(0, 0, sheet.width, sheet.height);
      // Drawn and copied in one task: the browser may empty the canvas after it.
      renderer.render(scene, camera);
      context.drawImage(canvas, 0, 0);
      paint(context, canvas.width / canvas.clientWidth);
      return new Promise((resolve, reject) => {
        sheet.toBlob(
          (blob) => (blob === null ? reject(new Error("the picture could not be written")) : resolve(blob)),
          "image/jpeg",
          JPEG_QUALITY,
        );
      });
    },
    dispose() {
      observer.disconnect();
      abort.abort();
      renderer.dispose();
      // Browsers allow a handful of contexts: this one is given back now, not when memory is collected.
      renderer.forceContextLoss();
      canvas.remove();
    },
  };
}
