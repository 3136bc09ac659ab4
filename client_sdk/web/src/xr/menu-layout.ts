/** What stands where on the menu: a list of rectangles in the panel's own units, without canvas or three.js. */

import type { HeadsetTool } from "./types.ts";

/** Panel units; one is half a millimetre. */
export const MENU_WIDTH = 1000;
export const MENU_HEIGHT = 880;

/** Radii to choose from, metres. */
export const RADII_M: readonly number[] = [10, 15, 20, 30, 40, 60, 80, 100, 150, 200];
/** Bookmarks on one page. */
const PAGE = 4;

export type MenuAction =
  | { readonly kind: "radius"; readonly radiusM: number }
  | { readonly kind: "mode"; readonly index: number }
  | { readonly kind: "turn"; readonly angleDeg: number }
  /** Turn now: hands have no thumbstick. Positive is to the left. */
  | { readonly kind: "snap"; readonly sign: 1 | -1 }
  | { readonly kind: "bookmark"; readonly index: number }
  | { readonly kind: "page"; readonly page: number }
  | { readonly kind: "tool"; readonly tool: HeadsetTool }
  | { readonly kind: "clear" }
  | { readonly kind: "overview" }
  | { readonly kind: "close" }
  | { readonly kind: "leave" };

export interface MenuItem {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  readonly text: string;
  /** `title` and `value` cannot be pressed; `value` is centred. */
  readonly look: "title" | "label" | "value" | "status" | "button" | "chosen" | "exit";
  readonly action: MenuAction | null;
}

export interface MenuModel {
  readonly radiusM: number;
  /** Largest radius that the service grants; null: not known. */
  readonly maxRadiusM: number | null;
  readonly modes: readonly string[];
  readonly modeIndex: number;
  readonly turnDeg: number;
  readonly bookmarks: readonly string[];
  readonly page: number;
  /** What the trigger does; null where it can only land. */
  readonly tool: HeadsetTool | null;
  /** Something is picked or measured. */
  readonly hasMarks: boolean;
  readonly hasOverview: boolean;
  /** One line on the landing and the link. */
  readonly status: string;
}

const LEFT = 40;
const VALUE = 330;
const ROW = 96;
const BUTTON = 80;

/** The menu's items, from top to bottom. */
export function layoutMenu(model: MenuModel): MenuItem[] {
  const items: MenuItem[] = [
    item(LEFT, 28, 380, 64, "terraport", "title"),
    item(LEFT, 92, MENU_WIDTH - 2 * LEFT, 48, model.status, "status"),
    item(MENU_WIDTH - LEFT - 170, 28, 170, 64, "Close", "button", { kind: "close" }),
  ];
  if (model.hasOverview) {
    items.push(item(MENU_WIDTH - LEFT - 170 - 20 - 270, 28, 270, 64, "Overview", "button", { kind: "overview" }));
  }
  let y = 156;
  items.push(item(LEFT, y, 280, BUTTON, "Radius", "label"));
  stepper(items, y, `${Math.round(model.radiusM)} m`, stepRadius(model, -1), stepRadius(model, 1));
  if (model.modes.length > 1) {
    y += ROW;
    items.push(item(LEFT, y, 280, BUTTON, "Ground", "label"));
    const count = model.modes.length;
    stepper(
      items,
      y,
      model.modes[model.modeIndex] ?? "",
      { kind: "mode", index: (model.modeIndex + count - 1) % count },
      { kind: "mode", index: (model.modeIndex + 1) % count },
    );
  }
  if (model.tool !== null) {
    y += ROW;
    addTools(items, model.tool, model.hasMarks, y);
  }
  y += ROW;
  items.push(item(LEFT, y, 280, BUTTON, "Turn", "label"));
  for (const [k, angleDeg] of [30, 45].entries()) {
    const look = angleDeg === model.turnDeg ? "chosen" : "button";
    items.push(item(VALUE + k * 160, y, 150, BUTTON, `${angleDeg}°`, look, { kind: "turn", angleDeg }));
  }
  items.push(item(VALUE + 340, y, 135, BUTTON, "↺", "button", { kind: "snap", sign: 1 }));
  items.push(item(VALUE + 495, y, 135, BUTTON, "↻", "button", { kind: "snap", sign: -1 }));
  y += ROW;
  addBookmarks(items, model, y);
  items.push(
    item(LEFT, MENU_HEIGHT - 116, MENU_WIDTH - 2 * LEFT, 88, "Leave the headset view", "exit", { kind: "leave" }),
  );
  return items;
}

/** The item under a place of the panel that can be pressed, or null. */
export function itemAt(items: readonly MenuItem[], x: number, y: number): MenuItem | null {
  for (const candidate of items) {
    const inside =
      x >= candidate.x && x < candidate.x + candidate.width && y >= candidate.y && y < candidate.y + candidate.height;
    if (candidate.action !== null && inside) {
      return candidate;
    }
  }
  return null;
}

/** Pages that so many bookmarks need; at least 1. */
export function pagesOf(bookmarks: number): number {
  return Math.max(1, Math.ceil(bookmarks / PAGE));
}

const TOOLS: readonly (readonly [HeadsetTool, string, number])[] = [
  ["land", "Land", 120],
  ["pick", "Pick", 110],
  ["measure", "Measure", 220],
];

function addTools(items: MenuItem[], chosen: HeadsetTool, hasMarks: boolean, y: number): void {
  items.push(item(LEFT, y, 280, BUTTON, "Trigger", "label"));
  let x = VALUE;
  for (const [tool, text, width] of TOOLS) {
    items.push(item(x, y, width, BUTTON, text, tool === chosen ? "chosen" : "button", { kind: "tool", tool }));
    x += width + 10;
  }
  items.push(item(x, y, MENU_WIDTH - LEFT - x, BUTTON, "Clear", "button", hasMarks ? { kind: "clear" } : null));
}

function addBookmarks(items: MenuItem[], model: MenuModel, top: number): void {
  if (model.bookmarks.length === 0) {
    return;
  }
  const pages = pagesOf(model.bookmarks.length);
  const page = Math.min(model.page, pages - 1);
  items.push(item(LEFT, top, 280, BUTTON, "Places", "label"));
  if (pages > 1) {
    const text = `${page + 1} of ${pages}`;
    items.push(item(LEFT, top + ROW, 200, 72, text, "button", { kind: "page", page: (page + 1) % pages }));
  }
  const names = model.bookmarks.slice(page * PAGE, page * PAGE + PAGE);
  const width = (MENU_WIDTH - LEFT - VALUE - 20) / 2;
  for (const [k, name] of names.entries()) {
    const x = VALUE + (k % 2) * (width + 20);
    const y = top + Math.floor(k / 2) * ROW;
    items.push(item(x, y, width, BUTTON, name, "button", { kind: "bookmark", index: page * PAGE + k }));
  }
}

function stepper(items: MenuItem[], y: number, text: string, less: MenuAction | null, more: MenuAction | null): void {
  const right = MENU_WIDTH - LEFT - 110;
  items.push(item(VALUE, y, 110, BUTTON, less?.kind === "mode" ? "‹" : "−", "button", less));
  items.push(item(VALUE + 120, y, right - VALUE - 130, BUTTON, text, "value"));
  items.push(item(right, y, 110, BUTTON, more?.kind === "mode" ? "›" : "+", "button", more));
}

/** The next radius of the list in one direction; null where there is none. */
function stepRadius(model: MenuModel, direction: -1 | 1): MenuAction | null {
  const maxRadiusM = model.maxRadiusM ?? Number.POSITIVE_INFINITY;
  const allowed = RADII_M.filter((radiusM) => radiusM <= maxRadiusM);
  const next =
    direction > 0
      ? allowed.find((radiusM) => radiusM > model.radiusM + 0.5)
      : allowed.findLast((radiusM) => radiusM < model.radiusM - 0.5);
  return next === undefined ? null : { kind: "radius", radiusM: next };
}

function item(
  x: number,
  y: number,
  width: number,
  height: number,
  text: string,
  look: MenuItem["look"],
  action: MenuAction | null = null,
): MenuItem {
  return { x, y, width, height, text, look, action };
}
