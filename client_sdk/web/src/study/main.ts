/**
 * The page of the study: `study.html?condition=head&participant=7#scene=ID`. One session: form, walk, form, log.
 *
 * It is the product's viewer, in one of two conditions; nothing of this is loaded by the product's own page.
 */

import { createAnnouncer } from "../app/announcer.ts";
import { h } from "../app/dom.ts";
import { codeOf, type Shell } from "../app/shell.ts";
import { localStorageOrMemory, sessionStorageOrMemory } from "../app/storage.ts";
import { createThemeSwitch } from "../app/theme.ts";
import { createTokenKeeper } from "../app/token.ts";
import { askForms } from "./forms.ts";
import { openSession, type StudySession } from "./session.ts";
import { parseSettings } from "./settings.ts";

declare global {
  interface Window {
    /** The session, for who drives the page: `terraport evaluate study` does. */
    study?: StudySession | undefined;
  }
}

const app = document.querySelector<HTMLElement>("#app")!;
/** Of what the session shows; the token's dialog and what is read out stand beside it. */
const root = h("div", {});
app.append(root);
const storage = localStorageOrMemory();
const shell: Shell = {
  serverUrl: new URL("./", window.location.href.split(/[?#]/)[0]).href,
  theme: createThemeSwitch(storage),
  token: createTokenKeeper(sessionStorageOrMemory(), app),
  announcer: createAnnouncer(app),
  storage,
  codeOf,
};

async function run(): Promise<void> {
  const settings = parseSettings(window.location.search, window.location.hash);
  // Forms come before anything is seen, and are answered on the page: a headset is off by then.
  const before = settings.asks ? await askForms(root, "before", () => 0) : [];
  const session = await openSession(shell, settings, root);
  for (const answers of before) session.log.form(answers);
  window.study = session;
  if (!settings.asks) return;
  const finish = h("button", { type: "button", id: "finish", class: "button primary" }, "Finish");
  const bar = h("div", { class: "study-bar" }, finish);
  root.append(bar);
  finish.addEventListener("click", async () => {
    bar.remove();
    session.stop();
    for (const answers of await askForms(root, "after", session.nowMs)) session.log.form(answers);
    save(session);
  });
}

/** The log stays with the participant's browser: it is downloaded, and sent nowhere. */
function save(session: StudySession): void {
  const text = JSON.stringify(session.log.toJson());
  const { participant, condition } = session.settings;
  const link = h(
    "a",
    {
      id: "save-log",
      class: "button primary",
      download: `study-${participant}-${condition}.json`,
      href: URL.createObjectURL(new Blob([text], { type: "application/json" })),
    },
    "Save the log",
  );
  root.append(h("main", { class: "study-form" }, h("h1", {}, "Thank you"), link));
}

run().catch((error: unknown) => {
  root.append(
    h(
      "main",
      { class: "study-form", id: "study-failed" },
      h("h1", {}, "The study could not begin"),
      h("p", {}, String(error)),
    ),
  );
});
