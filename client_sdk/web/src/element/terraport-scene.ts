/** `<terraport-scene src token at radius mode>`: a scene in any page, walked by clicks. */

import { budgetsFor, loadSceneInWorker, StreamError } from "../core/index.ts";
import type { LandOptions, SceneFiles, SceneManifest, Token, Vec3 } from "../core/types.ts";
import type { LandingStatus, Stage } from "../three/index.ts";
import { ShownScene } from "./shown-scene.ts";

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
  #shown: ShownScene | null = null;
  #manifest: SceneManifest | null = null;
  #opening: AbortController | null = null;
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
    this.#sizes = new ResizeObserver(() => this.#shown?.resize());
    this.#sight = new IntersectionObserver((entries) => {
      if (this.#shown !== null) this.#shown.isSeen = entries.at(-1)?.isIntersecting ?? true;
    });
  }

  /** What is drawn; null until the scene is open. */
  get stage(): Stage | null {
    return this.#shown?.stage ?? null;
  }

  /** What is known of the scene; null until it is open. */
  get manifest(): SceneManifest | null {
    return this.#manifest;
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
   * Land, and look there. Resolves when it is shown whole; rejects with StreamError where the scene is not open, the landing
   * is refused or superseded, or there is no link for 15 s; throws RangeError on numbers that cannot be.
   */
  async land(position: Vec3, radiusM?: number, options?: LandOptions): Promise<LandingStatus> {
    const shown = this.#shown;
    if (shown === null) throw new StreamError("closed", "the scene is not open yet: wait for the event `opened`");
    return shown.land(position, radiusM ?? shown.radiusM, options);
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
    const token: Token | undefined = this.#tokenSource ?? this.getAttribute("token") ?? undefined;
    const loadFiles = async (version?: string, onOverview?: (files: SceneFiles) => void) =>
      loadSceneInWorker(src, {
        token: typeof token === "function" ? await token() : token,
        version,
        signal,
        onOverview,
        onProgress: (done, total) => {
          if (this.#shown === null) this.#say(`Opening: ${Math.round((100 * done) / Math.max(1, total))} %`);
        },
      });
    this.#say("Opening");
    const show = (files: SceneFiles): void => {
      if (signal.aborted) return;
      try {
        this.#show(src, token, files, loadFiles);
      } catch (error) {
        opening.abort();
        this.#clear();
        this.#fail(new StreamError("no_webgl", String(error)));
      }
    };
    try {
      // The overview first, where the scene has one: the base takes its place, and a landing asked for meanwhile goes on.
      const files = await loadFiles(undefined, show);
      // Published anew in between: its base does not belong to the overview that is shown.
      if (!signal.aborted && this.#shown?.complete(files) !== true) show(files);
    } catch (error) {
      if (signal.aborted) return;
      this.#clear();
      this.#fail(error instanceof StreamError ? error : new StreamError("worker_failed", String(error)));
    }
  }

  /** Show a scene, in the place of what is shown. Throws where the browser has no WebGL 2. */
  #show(
    src: string,
    token: Token | undefined,
    files: SceneFiles,
    loadFiles: (version: string) => Promise<SceneFiles>,
  ): void {
    this.#clear();
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", `Ground of ${files.manifest.name}`);
    canvas.part.add("canvas");
    this.#root.prepend(canvas);
    this.#manifest = files.manifest;
    this.#shown = new ShownScene(
      {
        canvas,
        sceneUrl: src,
        token,
        files,
        budgets: budgetsFor(matchMedia("(pointer: coarse)").matches ? "phone" : "desktop"),
        loadFiles,
        isStill: () => matchMedia("(prefers-reduced-motion: reduce)").matches,
        radiusM: () => this.#radiusM,
      },
      {
        link: (link) => {
          if (link.state === "open") this.#say("");
          else if (link.state === "waiting") this.#say("No connection: trying again");
          else if (link.state === "closed") this.#fail(new StreamError(link.code, link.message));
        },
        landing: ({ phase, fraction }) => {
          if (phase === "planning" || phase === "streaming") this.#say(`Landing: ${Math.round(100 * fraction)} %`);
          else this.#say("");
        },
        landed: (status) => this.dispatchEvent(new CustomEvent("landed", { detail: status })),
        refused: (code, message) => this.#fail(new StreamError(code, message)),
        missed: () => this.#remark("There is no ground. Click where you want to land."),
      },
    );
    this.#say("");
    this.#setMode();
    this.dispatchEvent(new CustomEvent("opened", { detail: this.#manifest }));
    this.#landAt();
  }

  #close(): void {
    this.#forget();
    this.#opening?.abort();
    this.#opening = null;
    this.#clear();
  }

  /** Take away what is shown. */
  #clear(): void {
    this.#shown?.dispose();
    this.#shown = null;
    this.#manifest = null;
    this.#root.querySelector("canvas")?.remove();
  }

  /** Land where the attribute `at` says. */
  #landAt(): void {
    const text = this.getAttribute("at");
    if (text === null || this.#shown === null) return;
    const place = text
      .trim()
      .split(/[\s,]+/)
      .map(Number);
    if (place.length !== 3 || !place.every(Number.isFinite)) {
      this.#fail(new StreamError("invalid_attribute", `received at="${text}", expected three numbers: x y z, metres`));
      return;
    }
    this.land([place[0]!, place[1]!, place[2]!]).catch(() => undefined); // Told by the events.
  }

  #setMode(): void {
    const key = this.getAttribute("mode");
    if (this.#shown === null) return;
    try {
      this.#shown.stage.setMode(key ?? "colour");
    } catch (error) {
      this.#fail(new StreamError("invalid_attribute", `attribute mode: ${(error as Error).message}`));
      return;
    }
    this.#shown.draw();
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
      if (this.#shown !== null) this.#say("");
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
