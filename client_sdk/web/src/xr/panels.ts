/** The menu and the ray that points at it: opening, pressing, and what its buttons do. */

import type { Object3D } from "three";
import type { Vec3 } from "../core/types.ts";
import type { Pointer } from "./inputs.ts";
import { createMenu, type MenuMeeting } from "./menu.ts";
import type { MenuAction, MenuModel } from "./menu-layout.ts";
import { createRibbon } from "./ribbon.ts";
import type { HeadsetBookmark, HeadsetMenu, HeadsetTools } from "./types.ts";

/** How often an open menu looks whether something of it has changed. */
const REFRESH_MS = 250;

/** The ray ends on the panel and is drawn over it. */
const AFTER_PANELS = 940;

/** Panels hang within the arm's reach: their ray is short. */
const RAY_FADE_M = 0.2;

export interface MenuState {
  readonly menu: HeadsetMenu | undefined;
  readonly radiusM: () => number;
  readonly maxRadiusM: () => number | null;
  readonly status: () => string;
  readonly snap: (sign: 1 | -1) => void;
  /** Land at a bookmark; its radius is already set. */
  readonly visit: (bookmark: HeadsetBookmark) => void;
  readonly leave: () => void;
  readonly tools: HeadsetTools | undefined;
  /** Null where the scene has no model. */
  readonly openOverview: (() => void) | null;
}

export interface MenuDesk {
  readonly objects: readonly Object3D[];
  readonly open: boolean;
  /** Degrees of a snap turn. */
  readonly turnDeg: number;
  toggle(eye: Vec3, facingRad: number): void;
  hide(): void;
  /** Before the eyes again, after the user was moved or turned. */
  follow(eye: Vec3, facingRad: number): void;
  /** Once a frame: the ray to it, the light on the button under it. `aimBy` does not point at menus. */
  update(pointers: readonly Pointer[], aimBy: number, eye: Vec3, nowMs: number): void;
  /** A press: true where it fell on the menu, whatever was there. */
  press(pointer: Pointer): boolean;
  dispose(): void;
}

/** A menu, closed. */
export function createMenuDesk(state: MenuState): MenuDesk {
  const menu = createMenu();
  const ray = createRibbon(2, AFTER_PANELS, RAY_FADE_M);
  const ends = new Float32Array(6);
  let page = 0;
  let turnDeg = 30;
  let refreshedMs = 0;
  // Read anew each time: radius, mode and bookmarks are the page's, and may change while the menu is open.
  const model = (): MenuModel => ({
    radiusM: state.radiusM(),
    maxRadiusM: state.maxRadiusM(),
    modes: state.menu?.modes().map((each) => each.label) ?? [],
    modeIndex: state.menu?.modeIndex() ?? 0,
    turnDeg,
    bookmarks: state.menu?.bookmarks().map((each) => each.label) ?? [],
    page,
    tool: state.tools?.tool() ?? null,
    hasMarks: (state.tools?.picked() ?? state.tools?.measured() ?? null) !== null,
    hasOverview: state.openOverview !== null,
    status: state.status(),
  });
  const hide = (): void => {
    menu.hide();
    ray.hide();
  };
  const act = (action: MenuAction): void => {
    if (action.kind === "radius") {
      state.menu?.setRadiusM(action.radiusM);
    } else if (action.kind === "mode") {
      choose(state.menu, action.index);
    } else if (action.kind === "turn") {
      turnDeg = action.angleDeg;
    } else if (action.kind === "snap") {
      state.snap(action.sign);
    } else if (action.kind === "page") {
      page = action.page;
    } else if (action.kind === "bookmark") {
      const bookmark = state.menu?.bookmarks()[action.index];
      if (bookmark !== undefined) {
        hide();
        if (bookmark.radiusM !== null) {
          state.menu?.setRadiusM(bookmark.radiusM);
        }
        state.visit(bookmark);
      }
    } else if (action.kind === "tool") {
      state.tools?.setTool(action.tool);
    } else if (action.kind === "clear") {
      state.tools?.clear();
    } else if (action.kind === "overview") {
      hide();
      state.openOverview?.();
    } else if (action.kind === "close") {
      hide();
    } else {
      state.leave();
    }
  };
  return {
    objects: [menu.panel.object, ray.object],
    get open() {
      return menu.open;
    },
    get turnDeg() {
      return turnDeg;
    },
    toggle(eye, facingRad) {
      if (menu.open) {
        hide();
      } else {
        page = 0;
        menu.show(eye, facingRad, model());
      }
    },
    hide,
    follow(eye, facingRad) {
      if (menu.open) {
        menu.show(eye, facingRad, model());
      }
    },
    update(pointers, aimBy, eye, nowMs) {
      if (!menu.open) {
        return;
      }
      if (nowMs - refreshedMs > REFRESH_MS) {
        refreshedMs = nowMs;
        menu.refresh(model());
      }
      // The first pointer that meets the menu has the ray and the light; the one that aims is at the ground.
      let menuHit: MenuMeeting | null = null;
      for (const pointer of pointers) {
        menuHit = pointer.tracked && pointer.key !== aimBy ? menu.meet(pointer.origin, pointer.direction) : null;
        if (menuHit !== null) {
          layRay(ends, pointer, menuHit.distanceM);
          break;
        }
      }
      menu.hover(menuHit?.item ?? null);
      if (menuHit === null) {
        ray.hide();
      } else {
        ray.draw(ends, 2, eye, true);
      }
    },
    press(pointer) {
      const hit = menu.open && pointer.hasRay ? menu.meet(pointer.origin, pointer.direction) : null;
      if (hit === null) {
        return false;
      }
      // Taken even where no button is: a press on the plate must not begin an aim behind it.
      if (hit.item !== null && hit.item.action !== null) {
        act(hit.item.action);
      }
      if (menu.open) {
        menu.refresh(model());
      }
      return true;
    },
    dispose() {
      menu.dispose();
      ray.dispose();
    },
  };
}

function choose(menu: HeadsetMenu | undefined, index: number): void {
  const chosen = menu?.modes()[index];
  if (chosen !== undefined) {
    menu?.setMode(chosen.mode);
  }
}

function layRay(ends: Float32Array, pointer: Pointer, lengthM: number): void {
  for (let axis = 0; axis < 3; axis++) {
    ends[axis] = pointer.origin[axis]!;
    ends[3 + axis] = pointer.origin[axis]! + pointer.direction[axis]! * lengthM;
  }
}
