/** The scenes of the service, as cards. */

import { listScenes } from "../core/scene/load.ts";
import type { BuildingScene, SceneSummary } from "../core/types.ts";
import { fill, h } from "./dom.ts";
import { loadFailure } from "./failures.ts";
import { buildingStep, formatCompact, formatCount } from "./format.ts";
import { icon } from "./icons.ts";
import { relief } from "./relief.ts";
import { formatRoute, sceneRoute } from "./route.ts";
import { saveFile } from "./save-file.ts";
import type { Shell } from "./shell.ts";
import { actionButton, stateCard } from "./state-card.ts";

const BUILDING_PERIOD_MS = 2000;

/** The shell, and what the user meant by opening the list. */
export interface SceneListOptions {
  readonly shell: Shell;
  /** Whether a service with one scene opens it at once: not where the user asked for the list. */
  readonly opensOnlyScene: boolean;
}

/** A page of the app; the app puts `element` into the document, and disposes the page when it leaves. */
export interface Page {
  readonly element: HTMLElement;
  dispose(): void;
}

/**
 * Make the list, and load it. `main` holds one of four states: waiting, cards, empty, failed; each replaces the one before.
 *
 * `dispose` aborts what is under way: an answer that comes later must not write into a page that was left.
 */
export function createSceneList({ shell, opensOnlyScene }: SceneListOptions): Page {
  const abort = new AbortController();
  let timer: number | undefined;
  let shownScenes = "";
  const main = h("main", { id: "scene-list", class: "list-main" });
  const footer = h("footer", { class: "list-footer faint" });
  const element = h(
    "div",
    { class: "list-page" },
    h(
      "header",
      { class: "list-header" },
      h("a", { class: "wordmark", href: "#list" }, icon("mountain"), "terraport"),
      shell.theme.button(),
    ),
    main,
    footer,
  );
  document.title = "terraport";

  async function load(quietly = false): Promise<void> {
    if (!quietly) showWaiting();
    window.clearTimeout(timer);
    try {
      const list = await listScenes(shell.serverUrl, { token: shell.token.token, signal: abort.signal });
      const { scenes, building, links } = list;
      const onlyScene = scenes.length === 1 ? scenes[0] : undefined;
      if (onlyScene !== undefined && opensOnlyScene) {
        // Replaced: going back must not come here only to be sent forward again.
        window.location.replace(formatRoute(sceneRoute(onlyScene.id)));
        return;
      }
      const shown = scenes.map(({ id, version }) => `${id} ${version}`).join();
      if (quietly && shown === shownScenes) showBuilding(building);
      else showScenes(scenes, building);
      shownScenes = shown;
      showLinks(links);
      if (building.length > 0) timer = window.setTimeout(() => void load(true), BUILDING_PERIOD_MS);
    } catch (error) {
      if (!abort.signal.aborted) showFailure(error);
    }
  }

  function showWaiting(): void {
    const bone = () =>
      h(
        "li",
        { class: "card waiting", "aria-hidden": "true" },
        h("div", { class: "relief" }),
        h("div", { class: "card-text" }, h("div", { class: "bone" }), h("div", { class: "bone short" })),
        h("div", { class: "card-links" }),
      );
    fill(
      main,
      h("h1", {}, "Scenes"),
      h("p", { class: "faint", role: "status" }, "Asking the service what it has…"),
      h("ul", { class: "cards" }, bone(), bone(), bone()),
    );
  }

  function showScenes(scenes: readonly SceneSummary[], building: readonly BuildingScene[]): void {
    if (scenes.length === 0 && building.length === 0) {
      const reload = actionButton("Look again", "reload-list", () => void load(), true);
      const card = stateCard({
        id: "list-empty",
        icon: "mountain",
        title: "No scenes yet",
        children: [
          h("p", { class: "faint" }, "The service runs, but its folder has no scene. Make one from a survey with:"),
          h("code", {}, "terraport build SURVEY -o SCENES/NAME"),
        ],
        actions: [reload],
      });
      fill(main, card);
      return;
    }
    const noun = scenes.length === 1 ? "scene" : "scenes";
    fill(
      main,
      h("h1", {}, "Scenes"),
      h("p", { class: "faint", role: "status" }, `${formatCount(scenes.length)} ${noun}. Open one to look around.`),
      h("ul", { class: "cards" }, ...scenes.map(card), ...building.map(buildingCard)),
    );
    shell.announcer.announce(`${scenes.length} ${noun}`);
  }

  /** Beside the other cards, which stay: one of them may have the focus. */
  function showBuilding(building: readonly BuildingScene[]): void {
    for (const card of main.querySelectorAll("[data-building]")) card.remove();
    main.querySelector(".cards")?.append(...building.map(buildingCard));
  }

  /** A scene that is not there yet, or is made anew: nothing to open. */
  function buildingCard(scene: BuildingScene): HTMLElement {
    const percent = scene.share === null ? null : Math.round(scene.share * 100);
    const bar = h("div", {});
    bar.style.transform = `scaleX(${scene.share ?? 0})`;
    const track = h(
      "div",
      {
        class: "progress",
        role: "progressbar",
        "aria-label": `Build of ${scene.name}`,
        "aria-valuemin": 0,
        "aria-valuemax": 100,
        ...(percent === null ? {} : { "aria-valuenow": percent }),
      },
      bar,
    );
    return h(
      "li",
      { class: "card", "data-building": scene.id },
      relief(scene.id),
      h(
        "div",
        { class: "card-text" },
        h("h2", {}, scene.name),
        h("p", { class: "faint number" }, buildingStep(scene)),
        track,
      ),
      h("div", { class: "card-links" }, h("span", { class: "faint" }, "being built")),
    );
  }

  function card(scene: SceneSummary): HTMLElement {
    const segments = `${formatCount(scene.segments)} segments`;
    const triangles = `${formatCompact(scene.detailFaces)} triangles`;
    return h(
      "li",
      { class: "card", "data-scene": scene.id },
      picture(scene),
      h(
        "div",
        { class: "card-text" },
        h("h2", {}, h("a", { class: "card-open", href: formatRoute(sceneRoute(scene.id)) }, scene.name)),
        h(
          "p",
          { class: "faint number", title: `${formatCount(scene.detailFaces)} triangles` },
          `${triangles} · ${segments}`,
        ),
      ),
      h(
        "div",
        { class: "card-links" },
        h("span", { class: "faint" }, scene.id === scene.name ? "" : scene.id),
        scene.reportUrl !== "" && reportLink(scene, scene.reportUrl, "report.html"),
        scene.reportPdfUrl !== "" && reportLink(scene, scene.reportPdfUrl, "report.pdf"),
      ),
    );
  }

  /** What the build saw of it; contour lines until that is there, and where it never comes. */
  function picture({ id, previewUrl }: SceneSummary): HTMLElement {
    const frame = h("div", { class: "preview" }, relief(id));
    if (previewUrl !== "") void showPreview(frame, previewUrl);
    return frame;
  }

  async function showPreview(frame: HTMLElement, previewUrl: string): Promise<void> {
    try {
      const blob = await fetchFile(previewUrl);
      const image = h("img", { alt: "" });
      image.src = URL.createObjectURL(blob);
      await image.decode();
      URL.revokeObjectURL(image.src);
      fill(frame, image);
    } catch {
      // An ornament: the card says all without it.
    }
  }

  /** A file of a scene, asked for with the token, where there is one. */
  async function fetchFile(url: string): Promise<Blob> {
    const { token } = shell.token;
    const headers: HeadersInit = token === undefined ? {} : { Authorization: `Bearer ${token}` };
    const answer = await fetch(url, { headers, signal: abort.signal });
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    return answer.blob();
  }

  /** A link cannot carry a token: with one the report is fetched, and saved as a file. */
  function reportLink({ id, name }: SceneSummary, reportUrl: string, file: string): HTMLElement {
    const kind = file.endsWith(".pdf") ? "PDF" : "report";
    const properties = {
      href: reportUrl,
      target: "_blank",
      rel: "noreferrer",
      "aria-label": kind === "PDF" ? `Report of ${name} to print (PDF)` : `Build report of ${name}`,
    };
    if (shell.token.token === undefined) {
      return h("a", properties, icon("report"), kind === "PDF" ? kind : "Report");
    }
    return h(
      "a",
      {
        ...properties,
        "aria-label": kind === "PDF" ? `Save the report of ${name} to print (PDF)` : `Save the build report of ${name}`,
        on: {
          click: (event) => {
            event.preventDefault();
            void saveReport(reportUrl, `${id}-${file}`);
          },
        },
      },
      icon("report"),
      `Save ${kind}`,
    );
  }

  async function saveReport(reportUrl: string, fileName: string): Promise<void> {
    try {
      saveFile(await fetchFile(reportUrl), fileName);
      shell.announcer.announce("Report saved");
    } catch {
      shell.announcer.announce("The report could not be had. Try again later.", true);
    }
  }

  function showLinks(links: Readonly<Record<string, string>>): void {
    const link = (name: string, text: string) => {
      const address = links[name];
      return address !== undefined && h("a", { href: address }, text);
    };
    fill(footer, link("docs", "API"), link("metrics", "Metrics"));
    footer.hidden = footer.childElementCount === 0;
  }

  function showFailure(error: unknown): void {
    const code = shell.codeOf(error);
    const { title, text } = loadFailure(code, error instanceof Error ? error.message : "");
    const retry = actionButton("Try again", "reload-list", () => void load(), code !== "unauthorised");
    const token = actionButton("Enter a token", "token", () => void askToken(), true);
    fill(
      main,
      stateCard({
        id: code === "unauthorised" ? "list-token" : "list-failed",
        icon: code === "unauthorised" ? "key" : "warn",
        title,
        failed: code !== "unauthorised",
        children: [h("p", { class: "faint" }, text)],
        actions: code === "unauthorised" || code === "forbidden" ? [token] : [retry],
      }),
    );
    if (code === "unauthorised") void askToken();
  }

  async function askToken(): Promise<void> {
    const newToken = await shell.token.ask(shell.token.token === undefined ? "missing" : "refused");
    if (newToken !== null && !abort.signal.aborted) await load();
  }

  footer.hidden = true;
  void load();
  return {
    element,
    dispose() {
      abort.abort();
      window.clearTimeout(timer);
    },
  };
}
