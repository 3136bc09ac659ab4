/** The messages over the picture: one of a kind at a time, each with what to do. */

import type { Announcer } from "../announcer.ts";
import { fill, h, setText } from "../dom.ts";
import { type Notice, REMEDY_NAMES, type Remedy } from "../failures.ts";
import { icon } from "../icons.ts";

/** Messages over the picture by key. */
export interface Notices {
  readonly element: HTMLElement;
  /** Show one, in place of any of the same key. */
  show(notice: Notice): void;
  clear(key: string): void;
  /** What is shown, for diagnostics. */
  readonly current: readonly Notice[];
  dispose(): void;
}

/** An empty list. `act` carries out the remedy of a pressed button. */
export function createNotices(announcer: Announcer, act: (remedy: Remedy, key: string) => void): Notices {
  const element = h("div", { id: "notices", class: "notices", role: "region", "aria-label": "Messages" });
  const entries = new Map<string, { readonly notice: Notice; readonly box: HTMLElement; readonly text: HTMLElement }>();
  let timer: number | null = null;

  function tick(): void {
    const counting = [...entries.values()].filter(({ notice }) => notice.untilMs !== undefined);
    for (const { notice, text } of counting) setText(text, textOf(notice));
    timer = counting.length > 0 ? window.setTimeout(tick, 250) : null;
  }

  return {
    element,
    get current() {
      return [...entries.values()].map(({ notice }) => notice);
    },
    show(notice) {
      const previous = entries.get(notice.key);
      const text = previous?.text ?? h("p", {});
      const box = previous?.box ?? h("section", { class: "notice", "data-notice": notice.key });
      box.dataset.tone = notice.tone;
      setText(text, textOf(notice));
      // A button that has the focus must not vanish under it: only where the remedies differ are they made anew.
      if (previous === undefined || previous.notice.title !== notice.title || !sameRemedies(previous.notice, notice)) {
        const buttons = notice.remedies.map((remedy) =>
          h(
            "button",
            {
              type: "button",
              class: "button",
              "data-action": remedy,
              on: { click: () => act(remedy, notice.key) },
            },
            REMEDY_NAMES[remedy],
          ),
        );
        fill(
          box,
          icon(notice.tone === "info" ? "help" : "warn"),
          h("h2", {}, notice.title),
          text,
          h("div", { class: "notice-actions" }, ...buttons),
        );
        announcer.announce(`${notice.title}. ${textOf(notice)}`, notice.tone === "failure");
      }
      if (previous === undefined) element.append(box);
      entries.set(notice.key, { notice, box, text });
      if (timer === null) tick();
    },
    clear(key) {
      entries.get(key)?.box.remove();
      entries.delete(key);
    },
    dispose() {
      if (timer !== null) window.clearTimeout(timer);
    },
  };
}

function textOf(notice: Notice): string {
  if (notice.untilMs === undefined) return notice.text;
  const seconds = Math.max(0, Math.ceil((notice.untilMs - performance.now()) / 1000));
  return notice.text.replace("{seconds}", seconds === 0 ? "a moment" : `${seconds} s`);
}

function sameRemedies(a: Notice, b: Notice): boolean {
  return a.remedies.join() === b.remedies.join();
}
