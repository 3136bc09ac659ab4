/** The page: the list of scenes, or one scene, as the address has it. */

import { createAnnouncer } from "./announcer.ts";
import { parseRoute } from "./route.ts";
import { createSceneList, type Page } from "./scene-list.ts";
import { createScenePage, type ScenePage } from "./scene-page.ts";
import { codeOf, type Shell } from "./shell.ts";
import { localStorageOrMemory, sessionStorageOrMemory } from "./storage.ts";
import { createThemeSwitch } from "./theme.ts";
import { createTokenKeeper } from "./token.ts";

const root = document.querySelector("#app")!;
const pageRoot = document.createElement("div");
root.append(pageRoot);

const storage = localStorageOrMemory();
const shell: Shell = {
  // Without the hash and the query, and without "index.html": the page is the service's root.
  serverUrl: new URL("./", window.location.href.split(/[?#]/)[0]).href,
  theme: createThemeSwitch(storage),
  token: createTokenKeeper(sessionStorageOrMemory(), root),
  announcer: createAnnouncer(root),
  storage,
  codeOf,
};

let page: Page | null = null;
let scene: { readonly id: string; readonly page: ScenePage } | null = null;

function show(): void {
  const route = parseRoute(window.location.hash);
  if (route.scene !== null && scene?.id === route.scene) {
    scene.page.follow(route);
    return;
  }
  page?.dispose();
  scene = null;
  if (route.scene === null) {
    page = createSceneList({ shell, opensOnlyScene: window.location.hash.length <= 1 });
  } else {
    const scenePage = createScenePage(shell, route.scene, route);
    scene = { id: route.scene, page: scenePage };
    page = scenePage;
  }
  pageRoot.replaceChildren(page.element);
}

// `hashchange` comes for a typed or clicked address and for back and forward alike; `pushState` brings none.
window.addEventListener("hashchange", show);
show();
