/** `<terraport-scene src token at radius mode>`: a scene in any page, walked by clicks. */

import { Vector3 } from "three";

import { StreamError } from "../core/scene/errors.ts";
import type { LandOptions, SceneManifest, Vec3 } from "../core/types.ts";
import { type LandingStatus, Terrain, type TerrainIntersection } from "../three/index.ts";
import { SceneView } from "./scene-view.ts";

/** Events of the element: none of them bubbles. */
export interface TerraportSceneEventMap {
  /** The base is there, or an overview in its place until it is: one can look around, and land. */
  opened: CustomEvent<SceneManifest>;
  /** A landing is shown whole. */
  landed: CustomEvent<LandingStatus>;
  /** The scene cannot be opened, a landing was refused, the link is gone for good: a StreamError. */
  failed: CustomEvent<StreamError>;
}

const STYLE = `
:host { display: block; position: relative; min-height: 12rem; background: linear-gradient(#9db8cc, #dfe6e8); overflow: hidden }
:host([hidden]) { display: none }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; outline-offset: -3px }
p { position: absolute; inset: auto .5rem .5rem auto; margin: 0; padding: .25rem .6rem; border-radius: .4rem; max-width: 90%;
  background: #101820d9; color: #fff; font: .875rem/1.4 system-ui, sans-serif; pointer-events: none }
p:empty { display: none }
`;

/** Words that are no state go after so long. */
const REMARK_MS = 5000;

/**
 * The element. `import "@terraport/client/element"` defines it.
 *
 * Attributes: `src`, a scene's URL, ending in `/scenes/ID`; `token`; `at`, "x y z", where to land first; `radius` of
 * landings, metres (default: by the scene and the device); `mode`, how the ground is coloured: `colour`, `regions`, `slope`,
 * `attribute:NAME`. All may change at any time; another `src` or `token` opens anew. Tokens that end are renewed by the
 * property `tokenSource`.
 *
 * It has the size that the page gives it, draws only when something changes and somebody can see it, and frees all when it
 * is taken out of the page.
 */
export class TerraportScene extends HTMLElement {
  static readonly observedAttributes = ["src", "token", "at", "radius", "mode"];
  declare addEventListener: (<Name extends keyof TerraportSceneEventMap>(
    type: Name,
    listener: (event: TerraportSceneEventMap[Name]) => void,
    options?: boolean | AddEventListenerOptions,
  ) => void) &
    HTMLElement["addEventListener"];
  readonly #status: HTMLParagraphElement;
  readonly #root: ShadowRoot;
  readonly #sizes: ResizeObserver;
  readonly #sight: IntersectionObserver;
  #view: SceneView | null = null;
  #terrain: Terrain | null = null;
  #opening: AbortController | null = null;
  /** Landing that the camera moves to once it is shown; null where it stays. */
  #goesTo: number | null = null;
  #remarkTimer: number | null = null;
  #tokenSource: (() => string | Promise<string>) | null = null;

  constructor() {
    super();
    this.#root = this.attachShadow({ mode: "open" });
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(STYLE);
    this.#root.adoptedStyleSheets = [sheet];
    this.#status = document.createElement("p");
    this.#status.part.add("status");
    this.#status.setAttribute("role", "status");
    this.#root.append(this.#status);
    this.#sizes = new ResizeObserver(() => this.#view?.resize());
    this.#sight = new IntersectionObserver((entries) => {
      if (this.#view !== null) this.#view.isSeen = entries.at(-1)?.isIntersecting ?? true;
    });
  }

  /** The ground, for everything that this element has no attribute for; null until the scene is open. */
  get terrain(): Terrain | null {
    return this.#terrain;
  }

  /** What is known of the scene; null until it is open. */
  get manifest(): SceneManifest | null {
    return this.#terrain?.files.manifest ?? null;
  }

  /**
   * Asked for the present token before each connection and each loading, in place of the attribute `token`; a scene then
   * outlives its tokens. Null without. Another one opens anew.
   */
  get tokenSource(): (() => string | Promise<string>) | null {
    return this.#tokenSource;
  }

  set tokenSource(source: (() => string | Promise<string>) | null) {
    if (source === this.#tokenSource) return;
    this.#tokenSource = source;
    if (this.isConnected) void this.#open();
  }

  /**
   * Land, and look there. The promise is fulfilled when it is shown whole. It is rejected with a StreamError where the scene is
   * not open, where the landing is refused or superseded, or where there is no connection for 15 s; with a RangeError on
   * numbers that the protocol does not allow.
   */
  async land(position: Vec3, radiusM?: number, options?: LandOptions): Promise<LandingStatus> {
    const terrain = this.#terrain;
    if (terrain === null) throw new StreamError("closed", "the scene is not open yet: wait for the event `opened`");
    const landing = terrain.land(position, radiusM ?? this.#radiusM ?? terrain.defaultRadiusM, options);
    this.#goesTo = terrain.status.landing;
    this.#view?.draw();
    return landing;
  }

  connectedCallback(): void {
    this.#sizes.observe(this);
    this.#sight.observe(this);
    void this.#open();
  }

  disconnectedCallback(): void {
    this.#sizes.disconnect();
    this.#sight.disconnect();
    this.#close();
  }

  attributeChangedCallback(name: string, before: string | null, now: string | null): void {
    if (!this.isConnected || before === now) return;
    if (name === "src" || name === "token") void this.#open();
    else if (name === "at") this.#landAt();
    else if (name === "mode") this.#setMode();
  }

  async #open(): Promise<void> {
    this.#close();
    const src = this.getAttribute("src");
    if (src === null || src === "") {
      this.#say("");
      return;
    }
    const opening = new AbortController();
    this.#opening = opening;
    const { signal } = opening;
    this.#say("Opening");
    let view: SceneView;
    try {
      view = new SceneView((hit) => this.#click(hit));
    } catch (error) {
      this.#fail(new StreamError("no_webgl", String(error)));
      return;
    }
    this.#view = view;
    const token = this.#tokenSource ?? this.getAttribute("token");
    try {
      const terrain = await Terrain.open(src, {
        renderer: view.renderer,
        ...(token !== null && { token }),
        signal,
        onProgress: (done, total) => {
          if (this.#terrain === null) this.#say(`Opening: ${Math.round((100 * done) / Math.max(1, total))} %`);
        },
      });
      if (signal.aborted) terrain.dispose();
      else this.#show(view, terrain);
    } catch (error) {
      if (signal.aborted) return;
      this.#close();
      this.#fail(error instanceof StreamError ? error : new StreamError("worker_failed", String(error)));
    }
  }

  #show(view: SceneView, terrain: Terrain): void {
    this.#terrain = terrain;
    const { canvas } = view;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", `Ground of ${terrain.files.manifest.name}`);
    canvas.part.add("canvas");
    this.#root.prepend(canvas);
    terrain.addEventListener("link", ({ link }) => {
      if (link.state === "open") this.#say("");
      else if (link.state === "waiting") this.#say("No connection: trying again");
    });
    terrain.addEventListener("landing", ({ status: { phase, fraction } }) => {
      if (phase === "planning" || phase === "streaming") this.#say(`Landing: ${Math.round(100 * fraction)} %`);
      else this.#say("");
    });
    terrain.addEventListener("swapped", ({ report: { landing } }) => {
      terrain.markFresh();
      if (landing !== this.#goesTo) return;
      this.#goesTo = null;
      view.flyTo(new Vector3(...terrain.status.position), terrain.status.radiusM);
    });
    terrain.addEventListener("landed", ({ status }) =>
      this.dispatchEvent(new CustomEvent("landed", { detail: status })),
    );
    terrain.addEventListener("failed", ({ error }) => this.#fail(error));
    view.show(terrain);
    this.#say("");
    this.#setMode();
    this.dispatchEvent(new CustomEvent("opened", { detail: terrain.files.manifest }));
    this.#landAt();
  }

  #click(hit: TerrainIntersection | null): void {
    if (hit === null) this.#remark("There is no ground. Click where you want to land.");
    else this.land(hit.ground.position).catch(() => undefined); // Reported by the events.
  }

  #close(): void {
    this.#forget();
    this.#opening?.abort();
    this.#opening = null;
    this.#terrain?.dispose();
    this.#terrain = null;
    this.#view?.dispose();
    this.#view = null;
  }

  /** Land where the attribute `at` says. */
  #landAt(): void {
    const text = this.getAttribute("at");
    if (text === null || this.#terrain === null) return;
    const place = text
      .trim()
      .split(/[\s,]+/)
      .map(Number);
    if (place.length !== 3 || !place.every(Number.isFinite)) {
      this.#fail(new StreamError("invalid_attribute", `received at="${text}", expected three numbers: x y z, metres`));
      return;
    }
    this.land([place[0]!, place[1]!, place[2]!]).catch(() => undefined); // Reported by the events.
  }

  #setMode(): void {
    const key = this.getAttribute("mode");
    if (this.#terrain === null) return;
    try {
      this.#terrain.setMode(key ?? "colour");
    } catch (error) {
      this.#fail(new StreamError("invalid_attribute", `attribute mode: ${(error as Error).message}`));
      return;
    }
    this.#view?.draw();
  }

  /** The attribute; null where it is left to the scene, or says nothing that can be. */
  get #radiusM(): number | null {
    const radiusM = Number(this.getAttribute("radius") ?? Number.NaN);
    return radiusM > 0 && Number.isFinite(radiusM) ? radiusM : null;
  }

  #fail(error: StreamError): void {
    this.#remark(error.message);
    this.dispatchEvent(new CustomEvent("failed", { detail: error }));
  }

  /** Say something that no state of the scene takes away for a while. */
  #remark(text: string): void {
    this.#forget();
    this.#say(text);
    this.#remarkTimer = window.setTimeout(() => {
      this.#forget();
      // What keeps the scene from being shown stays.
      if (this.#terrain !== null) this.#say("");
    }, REMARK_MS);
  }

  #forget(): void {
    if (this.#remarkTimer !== null) window.clearTimeout(this.#remarkTimer);
    this.#remarkTimer = null;
  }

  /** Say how the scene stands, unless there is a remark. */
  #say(text: string): void {
    if (this.#remarkTimer === null && this.#status.textContent !== text) this.#status.textContent = text;
  }
}
