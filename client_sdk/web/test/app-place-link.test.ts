import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Route } from "../src/app/route.ts";
import { createPlaceLink, type PlaceLink } from "../src/app/viewer/place-link.ts";

/** As much of a browser's window as an address needs: entries, and where the user is among them. */
function fakeWindow() {
  const entries = ["#scene=s"];
  let goneBack: (() => void) | null = null;
  return {
    entries,
    goBack: () => goneBack?.(),
    setTimeout: (run: () => void, ms?: number) => Number(setTimeout(run, ms)),
    clearTimeout: (timer: number) => clearTimeout(timer),
    addEventListener: (_: string, listener: () => void) => {
      goneBack = listener;
    },
    removeEventListener: () => {},
    get location() {
      return { hash: entries.at(-1)! };
    },
    history: {
      pushState: (_: unknown, __: string, hash: string) => entries.push(hash),
      replaceState: (_: unknown, __: string, hash: string) => entries.splice(-1, 1, hash),
    },
  };
}

const route = (x: number): Route => ({
  scene: "s",
  place: { at: [x, 0, 0], radiusM: 50, view: null, yawDeg: null, pitchDeg: null, distanceM: null, focus: null },
  mode: null,
});

let browser: ReturnType<typeof fakeWindow>;
let link: PlaceLink;

beforeEach(() => {
  vi.useFakeTimers();
  browser = fakeWindow();
  vi.stubGlobal("window", browser);
  link = createPlaceLink();
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

test("two landings in one turn are two entries", () => {
  link.push(route(1));
  link.push(route(2));
  vi.runAllTimers();
  expect(browser.entries).toHaveLength(3);
});

test("a look that changes at once does not cost the landing its entry", () => {
  link.push(route(1));
  link.follow(() => route(1));
  vi.runAllTimers();
  expect(browser.entries).toHaveLength(2);
});

test("the present entry follows the look, once", () => {
  link.push(route(1));
  vi.runAllTimers();
  link.follow(() => route(3));
  link.follow(() => null);
  vi.runAllTimers();
  link.follow(() => route(4));
  vi.runAllTimers();
  expect(browser.entries).toHaveLength(2);
  expect(browser.entries.at(-1)).toContain("at=4");
});

test("back before the entry is written drops it", () => {
  link.push(route(1));
  browser.goBack();
  vi.runAllTimers();
  expect(browser.entries).toEqual(["#scene=s"]);
});
