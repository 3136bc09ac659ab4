import { describe, expect, test } from "vitest";
import type { LandingStatus } from "../src/three/types.ts";
import { itemAt, layoutMenu, MENU_HEIGHT, MENU_WIDTH, type MenuModel, pagesOf } from "../src/xr/menu-layout.ts";
import { type Announced, messageOf, sentence, statusLine, wrapText } from "../src/xr/messages.ts";
import { meetPanel, panelBefore } from "../src/xr/panel-place.ts";

const model: MenuModel = {
  radiusM: 60,
  maxRadiusM: 120,
  modes: ["Colour", "Regions", "Slope"],
  modeIndex: 0,
  turnDeg: 30,
  bookmarks: ["Gate", "Crusher", "Pond", "Bench 4", "Rim"],
  page: 0,
  tool: "land",
  hasMarks: true,
  hasOverview: true,
  status: "Landed, 60 m around.",
};

describe("menu", () => {
  test.each([
    ["everything", model],
    ["the second page", { ...model, page: 1 }],
    ["no bookmarks and one mode", { ...model, bookmarks: [], modes: ["Colour"] }],
  ])("with %s: all within the panel, no two buttons over each other", (_, each) => {
    const items = layoutMenu(each);
    for (const item of items) {
      expect(item.x).toBeGreaterThanOrEqual(0);
      expect(item.y).toBeGreaterThanOrEqual(0);
      expect(item.x + item.width).toBeLessThanOrEqual(MENU_WIDTH);
      expect(item.y + item.height).toBeLessThanOrEqual(MENU_HEIGHT);
    }
    for (const [k, a] of items.entries()) {
      for (const b of items.slice(k + 1)) {
        const apart = a.x + a.width <= b.x || b.x + b.width <= a.x || a.y + a.height <= b.y || b.y + b.height <= a.y;
        expect(apart, `${a.text} and ${b.text}`).toBe(true);
      }
    }
  });

  test("buttons are at least 35 mm high: a ray from the hand shakes", () => {
    for (const item of layoutMenu(model)) {
      if (item.action !== null) {
        expect(item.height).toBeGreaterThanOrEqual(64);
      }
    }
  });

  test("the radius steps through the list, and not beyond what the service grants", () => {
    const radii = (each: MenuModel): (number | null)[] =>
      layoutMenu(each)
        .filter((item) => item.text === "−" || item.text === "+")
        .map((item) => (item.action?.kind === "radius" ? item.action.radiusM : null));
    expect(radii(model)).toEqual([40, 80]);
    expect(radii({ ...model, radiusM: 47 })).toEqual([40, 60]);
    expect(radii({ ...model, radiusM: 100 })).toEqual([80, null]);
    expect(radii({ ...model, radiusM: 10 })).toEqual([null, 15]);
    expect(radii({ ...model, radiusM: 200, maxRadiusM: null })).toEqual([150, null]);
  });

  test("is pressed where it says so, and only there", () => {
    const items = layoutMenu(model);
    const leave = items.find((item) => item.action?.kind === "leave")!;
    expect(itemAt(items, leave.x + 5, leave.y + 5)).toBe(leave);
    expect(itemAt(items, leave.x - 5, leave.y + 5)).toBeNull();
    const title = items.find((item) => item.look === "title")!;
    expect(itemAt(items, title.x + 5, title.y + 5)).toBeNull();
  });

  test("bookmarks come in pages of four, each with its own number", () => {
    const indices = (each: MenuModel): number[] =>
      layoutMenu(each).flatMap((item) => (item.action?.kind === "bookmark" ? [item.action.index] : []));
    expect(indices(model)).toEqual([0, 1, 2, 3]);
    expect(indices({ ...model, page: 1 })).toEqual([4]);
    expect(indices({ ...model, page: 9 })).toEqual([4]);
    expect([pagesOf(0), pagesOf(4), pagesOf(5)]).toEqual([1, 1, 2]);
  });
});

describe("panel", () => {
  test("hangs before the eyes, and a ray at its middle meets its middle", () => {
    for (const facing of [0, 1, -2.5, 3.1]) {
      const eye = [5, 1.6, -3] as const;
      const pose = panelBefore(eye, facing, 1.5, 0.3);
      const along = pose.centre.map((value, axis) => value - eye[axis]!) as [number, number, number];
      const met = meetPanel(pose, eye, along)!;
      expect(met.x).toBeCloseTo(0);
      expect(met.y).toBeCloseTo(0);
      expect(met.distanceM).toBeCloseTo(Math.hypot(1.5, 0.3));
      // Square to the line of sight: it leans back by as much as one looks down at it.
      expect(met.distanceM).toBeCloseTo(Math.hypot(...along));
    }
  });

  test("right is right and up is up, to somebody who looks north", () => {
    const pose = panelBefore([0, 1.6, 0], 0, 1, 0);
    const met = meetPanel(pose, [0, 1.6, 0], [0.1, 0.2, -1])!;
    expect(met.x).toBeCloseTo(0.1);
    expect(met.y).toBeCloseTo(0.2);
  });

  test("is not met from behind, backwards, or along", () => {
    const pose = panelBefore([0, 1.6, 0], 0, 1, 0);
    expect(meetPanel(pose, [0, 1.6, -3], [0, 0, 1])).toBeNull();
    expect(meetPanel(pose, [0, 1.6, 0], [0, 0, 1])).toBeNull();
    expect(meetPanel(pose, [0, 1.6, 0], [1, 0, 0])).toBeNull();
  });
});

describe("messages", () => {
  test("a lost link is told once, and its return only after that", () => {
    const announced: Announced = { linkLost: false };
    const waiting = {
      type: "link",
      link: { state: "waiting", attempt: 1, retryInMs: 500, closeCode: 1006, code: "lost", message: "gone" },
    } as const;
    const open = { type: "link", link: { state: "open" } } as const;
    expect(messageOf(open, announced)).toBeNull();
    expect(messageOf(waiting, announced)).toMatchObject({ tone: "warning", stays: true });
    expect(messageOf(waiting, announced)).toBeNull();
    expect(messageOf(open, announced)).toMatchObject({ tone: "info", stays: false });
    expect(messageOf(open, announced)).toBeNull();
  });

  test("the service's own words become a sentence", () => {
    expect(sentence("no more than 8 sessions")).toBe("No more than 8 sessions.");
    expect(sentence("Really?")).toBe("Really?");
    expect(sentence("")).toBe("The service gave no reason.");
  });

  test("a refused landing is told where the landing is known, not twice", () => {
    const refused = { type: "refused", code: "x", message: "too far out", fatal: false, landing: 3 } as const;
    expect(messageOf(refused, { linkLost: false })).toBeNull();
    expect(messageOf({ ...refused, landing: null }, { linkLost: false })?.text).toBe("Too far out.");
  });

  test("lines are broken at words and never lost", () => {
    const text = "The link is lost. The ground you see stays; trying to reconnect.";
    const lines = wrapText(text, 24, (line) => line.length);
    expect(lines.join(" ")).toBe(text);
    expect(Math.max(...lines.map((line) => line.length))).toBeLessThanOrEqual(24);
    expect(wrapText("unbreakable", 4, (line) => line.length)).toEqual(["unbreakable"]);
  });

  test("the landing in one line", () => {
    const status: LandingStatus = {
      landing: 1,
      phase: "streaming",
      position: [0, 0, 0],
      radiusM: 60,
      fraction: 0.427,
      plan: null,
      readyMs: null,
      presentableMs: null,
      payloadBytes: 0,
      missing: [],
      refusal: null,
    };
    expect(statusLine(status, false)).toBe("Loading the ground: 42 %.");
    expect(statusLine({ ...status, phase: "shown" }, true)).toBe("No link. Landed, 60 m around.");
    expect(statusLine({ ...status, phase: "shown", missing: ["4", "5"] }, false)).toContain("2 segments missing");
  });
});
