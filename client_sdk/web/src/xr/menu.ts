/** The menu in the headset: drawn from its layout, pointed at by a hand or controller, pressed by selecting. */

import { Mesh, MeshBasicMaterial, PlaneGeometry } from "three";
import type { Vec3 } from "../core/types.ts";
import { itemAt, layoutMenu, MENU_HEIGHT, MENU_WIDTH, type MenuItem, type MenuModel } from "./menu-layout.ts";
import { createPanel, drawPlate, FONT, METRES_PER_UNIT, type Panel } from "./panel.ts";
import { meetPanel, panelBefore } from "./panel-place.ts";

const AWAY_M = 0.75;
const BELOW_M = 0.22;
/** From the eyes, metres, and the smallest letters, units. */
export const MENU_AWAY_M = Math.hypot(AWAY_M, BELOW_M);
export const MENU_FONTS = { title: 52, status: 40, button: 42 } as const;

export interface MenuMeeting {
  readonly item: MenuItem | null;
  readonly distanceM: number;
}

export interface Menu {
  readonly panel: Panel;
  readonly open: boolean;
  /** Hang it before the user's eyes. */
  show(eye: Vec3, facingRad: number, model: MenuModel): void;
  hide(): void;
  /** Draw it anew where something of it changed. */
  refresh(model: MenuModel): void;
  /** Where a ray meets it; null where it passes by. */
  meet(origin: Vec3, direction: Vec3): MenuMeeting | null;
  /** Light the item up that is pointed at. */
  hover(item: MenuItem | null): void;
  dispose(): void;
}

/** A menu, hidden. */
export function createMenu(): Menu {
  const panel = createPanel("headset-menu", MENU_WIDTH, MENU_HEIGHT);
  const geometry = new PlaneGeometry(1, 1);
  const material = new MeshBasicMaterial({
    color: 0xffffff,
    transparent: true,
    opacity: 0.22,
    depthTest: false,
    depthWrite: false,
    fog: false,
  });
  // A light of its own over the button: a new drawing of the canvas would cost an upload each time the ray moves on.
  const light = new Mesh(geometry, material);
  light.renderOrder = 901;
  light.visible = false;
  panel.object.add(light);
  let items: readonly MenuItem[] = [];
  let drawn = "";
  const redraw = (model: MenuModel): void => {
    const key = JSON.stringify(model);
    if (key !== drawn) {
      drawn = key;
      items = layoutMenu(model);
      panel.draw((context) => drawMenu(context, items));
    }
  };
  return {
    panel,
    get open() {
      return panel.object.visible;
    },
    show(eye, facingRad, model) {
      redraw(model);
      panel.moveTo(panelBefore(eye, facingRad, AWAY_M, BELOW_M));
    },
    hide() {
      light.visible = false;
      panel.hide();
    },
    refresh: redraw,
    meet(origin, direction) {
      const { pose } = panel;
      const hit = pose === null ? null : meetPanel(pose, origin, direction);
      if (hit === null) {
        return null;
      }
      const x = hit.x / METRES_PER_UNIT + MENU_WIDTH / 2;
      const y = MENU_HEIGHT / 2 - hit.y / METRES_PER_UNIT;
      if (x < 0 || y < 0 || x > MENU_WIDTH || y > MENU_HEIGHT) {
        return null;
      }
      return { item: itemAt(items, x, y), distanceM: hit.distanceM };
    },
    hover(item) {
      light.visible = item !== null;
      if (item !== null) {
        light.position.set(
          (item.x + item.width / 2 - MENU_WIDTH / 2) * METRES_PER_UNIT,
          (MENU_HEIGHT / 2 - item.y - item.height / 2) * METRES_PER_UNIT,
          0.001,
        );
        light.scale.set(item.width * METRES_PER_UNIT, item.height * METRES_PER_UNIT, 1);
      }
    },
    dispose() {
      geometry.dispose();
      material.dispose();
      panel.dispose();
    },
  };
}

const FILLS: Readonly<Record<MenuItem["look"], string | null>> = {
  title: null,
  label: null,
  value: null,
  status: null,
  button: "#2b3542",
  chosen: "#1d6fa3",
  exit: "#7a3222",
};

function drawMenu(context: CanvasRenderingContext2D, items: readonly MenuItem[]): void {
  drawPlate(context, MENU_WIDTH, MENU_HEIGHT, "rgba(16, 20, 26, 0.94)", "#55677a");
  context.textBaseline = "middle";
  for (const item of items) {
    const pressable = item.action !== null;
    const fill = FILLS[item.look];
    if (fill !== null) {
      context.globalAlpha = pressable ? 1 : 0.35;
      context.beginPath();
      context.roundRect(item.x, item.y, item.width, item.height, 18);
      context.fillStyle = fill;
      context.fill();
      if (item.look === "chosen") {
        context.lineWidth = 5;
        context.strokeStyle = "#8fd3ff";
        context.stroke();
      }
    }
    const isLeftAligned = item.look === "title" || item.look === "label" || item.look === "status";
    context.textAlign = isLeftAligned ? "left" : "center";
    context.fillStyle = item.look === "status" ? "#b6c2cf" : "#f2f5f8";
    context.font = fontOf(item);
    const x = isLeftAligned ? item.x : item.x + item.width / 2;
    context.fillText(fitText(context, item.text, item.width - 16), x, item.y + item.height / 2);
    context.globalAlpha = 1;
  }
}

function fontOf(item: MenuItem): string {
  if (item.look === "title") {
    return `700 ${MENU_FONTS.title}px ${FONT}`;
  }
  if (item.look === "status") {
    return `400 ${MENU_FONTS.status}px ${FONT}`;
  }
  return `500 ${MENU_FONTS.button}px ${FONT}`;
}

/** Cut a text that is too long, with an ellipsis: squeezed letters are harder to read than few. */
function fitText(context: CanvasRenderingContext2D, text: string, maxWidth: number): string {
  if (context.measureText(text).width <= maxWidth) {
    return text;
  }
  let shortened = text;
  while (shortened.length > 1 && context.measureText(`${shortened}…`).width > maxWidth) {
    shortened = shortened.slice(0, -1);
  }
  return `${shortened.trimEnd()}…`;
}
