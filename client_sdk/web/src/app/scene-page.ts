/** One scene: loaded, shown, and loaded anew where the service publishes another version of it. */

import { loadSceneInWorker, openStream, sharesOf } from "../core/index.ts";
import { sceneUrlOf } from "../core/scene/urls.ts";
import type { SceneFiles } from "../core/types.ts";
import { deviceBudgets } from "../three/device.ts";
import { h, setText } from "./dom.ts";
import { loadFailure } from "./failures.ts";
import { formatBytes } from "./format.ts";
import type { Route } from "./route.ts";
import type { Page } from "./scene-list.ts";
import type { Shell } from "./shell.ts";
import { actionButton, stateCard } from "./state-card.ts";
import { createViewer, type Viewer } from "./viewer/viewer.ts";

/** Page of one scene over all its versions. */
export interface ScenePage extends Page {
  /** The address changed, within the same scene: go there. */
  follow(route: Route): void;
}

/**
 * Load a scene and show it.
 *
 * One load and one viewer at a time: a newer load aborts the one before, and a viewer is closed before the next is made, since
 * browsers allow a handful of WebGL contexts only. `route` outlives both, so that a reload comes back to the same place.
 */
export function createScenePage(shell: Shell, id: string, firstRoute: Route): ScenePage {
  const element = h("div", { class: "scene-page" });
  const sceneUrl = sceneUrlOf(shell.serverUrl, id);
  let route = firstRoute;
  let viewer: Viewer | null = null;
  let loading: AbortController | null = null;
  let disposed = false;

  /** Load that version, or the newest, and open a session of it. */
  async function load(version?: string): Promise<void> {
    loading?.abort();
    const abort = new AbortController();
    loading = abort;
    const progress = showLoading();
    const onOverview = (files: SceneFiles) => {
      if (!abort.signal.aborted) open(files);
    };
    try {
      const files = await loadFiles(version, abort.signal, progress, onOverview);
      if (abort.signal.aborted) return;
      // Published anew while the overview was looked at: what was landed at is asked for again.
      if (viewer?.complete(files) !== true) reopen(files);
    } catch (error) {
      if (abort.signal.aborted) return;
      close();
      // Gone already: the new session is one of the newest.
      if (version !== undefined && shell.codeOf(error) === "unknown_scene") void load();
      else showFailure(error);
    }
  }

  function loadFiles(
    version: string | undefined,
    signal: AbortSignal,
    onProgress?: (doneBytes: number, totalBytes: number) => void,
    onOverview?: (files: SceneFiles) => void,
  ): Promise<SceneFiles> {
    const { token } = shell.token;
    const access = token === undefined ? {} : { token };
    return loadSceneInWorker(sceneUrl, { ...access, version, onProgress, onOverview, signal });
  }

  /** In the place of the viewer that is open, where one is. */
  function reopen(files: SceneFiles): void {
    route = viewer?.route ?? route;
    close();
    open(files);
  }

  function open(files: SceneFiles): void {
    // Its first event says of which version it is; the stage compares that with the files.
    const budgets = deviceBudgets();
    const { token } = shell.token;
    const stream = openStream({
      sceneUrl,
      ...(token === undefined ? {} : { token }),
      budgets: sharesOf(budgets, files).budgets,
      cacheBytes: budgets.cacheBytes,
      diskBytes: budgets.diskBytes,
      creditBytes: budgets.creditBytes,
    });
    try {
      viewer = createViewer({
        shell,
        sceneUrl,
        files,
        stream,
        budgets,
        route,
        guides: window.parent === window,
        reload: (version) => {
          // Before it is closed: where the user is now is where the new version opens.
          route = viewer?.route ?? route;
          close();
          void load(version);
        },
        loadFiles: (version) => loadFiles(version, new AbortController().signal),
      });
    } catch (error) {
      // No viewer owns it: it would stay connected.
      stream.close();
      showNoGraphics(error);
      return;
    }
    document.title = `${files.manifest.name} · terraport`;
    element.replaceChildren(viewer.element);
    viewer.start();
  }

  /** A card is the whole page: its main landmark. */
  function showCard(card: HTMLElement): void {
    element.replaceChildren(h("main", {}, card));
  }

  function showLoading(): (doneBytes: number, totalBytes: number) => void {
    const bar = h("div", {});
    const text = h("p", { class: "faint number", "aria-hidden": "true" }, "Asking the service…");
    const track = h(
      "div",
      {
        id: "load-progress",
        class: "progress",
        role: "progressbar",
        "aria-label": "Ground of the scene",
        "aria-valuemin": 0,
        "aria-valuemax": 100,
        "aria-valuenow": 0,
      },
      bar,
    );
    showCard(stateCard({ id: "scene-loading", icon: "mountain", title: `Opening ${id}`, children: [track, text] }));
    return (doneBytes, totalBytes) => {
      const fraction = totalBytes > 0 ? Math.min(1, doneBytes / totalBytes) : 0;
      bar.style.transform = `scaleX(${fraction})`;
      track.setAttribute("aria-valuenow", String(Math.round(fraction * 100)));
      setText(text, `${formatBytes(doneBytes)} of ${formatBytes(totalBytes)}`);
    };
  }

  function showFailure(error: unknown): void {
    const code = shell.codeOf(error);
    const { title, text } = loadFailure(code, error instanceof Error ? error.message : "");
    const needsToken = code === "unauthorised" || code === "forbidden";
    const actions = [
      needsToken
        ? actionButton("Enter a token", "token", () => void askToken(), true)
        : actionButton("Try again", "reload-scene", () => void load(), true),
      actionButton("All scenes", "scenes", () => window.location.assign("#list")),
    ];
    showCard(
      stateCard({
        id: needsToken ? "scene-token" : "scene-failed",
        icon: needsToken ? "key" : "warn",
        title,
        failed: true,
        children: [h("p", { class: "faint" }, text)],
        actions,
      }),
    );
    if (code === "unauthorised") void askToken();
  }

  function showNoGraphics(error: unknown): void {
    showCard(
      stateCard({
        id: "no-webgl",
        icon: "warn",
        title: "This browser cannot draw the scene",
        failed: true,
        children: [
          h(
            "p",
            { class: "faint" },
            "The viewer needs WebGL 2. Switch on graphics acceleration in the browser's settings, close other pages that draw in 3D, or use another browser.",
          ),
          h("p", { class: "faint" }, error instanceof Error ? error.message : ""),
        ],
        actions: [
          actionButton("Try again", "reload-scene", () => void load(), true),
          actionButton("All scenes", "scenes", () => window.location.assign("#list")),
        ],
      }),
    );
  }

  async function askToken(): Promise<void> {
    const newToken = await shell.token.ask(shell.token.token === undefined ? "missing" : "refused");
    if (newToken !== null && !disposed) void load();
  }

  function close(): void {
    viewer?.dispose();
    viewer = null;
  }

  void load();
  return {
    element,
    follow(next) {
      route = next;
      viewer?.follow(next);
    },
    dispose() {
      disposed = true;
      loading?.abort();
      close();
    },
  };
}
