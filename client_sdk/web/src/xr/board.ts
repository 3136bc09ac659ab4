/** The message board: a line or three before the eyes, fixed in the world where it appeared, gone after a few seconds. */

import type { Vec3 } from "../core/types.ts";
import { wrapText } from "./messages.ts";
import { createPanel, drawPlate, FONT, type Panel } from "./panel.ts";
import { panelBefore } from "./panel-place.ts";
import { wrapAngle } from "./pose.ts";
import type { Tone } from "./types.ts";

const WIDTH = 1600;
const HEIGHT = 440;
export const BOARD_FONT = 76;
const LINE = 96;
/** Ahead, and a little above the eyes: below them hangs the menu, and there is the ring. */
export const BOARD_AWAY_M = 1.5;
const BELOW_M = -0.12;
/** How long a message stays that does not stay. */
const LASTS_MS = 5000;
/** Turned away further than this, the board comes round when it has something new to say. */
const BESIDE_RAD = Math.PI / 4;

export interface Board {
  readonly panel: Panel;
  /** Show a text; `stays`: until the next. */
  show(text: string, tone: Tone, stays: boolean, nowMs: number): void;
  /** Once a frame: hangs it up where it is due, takes it down in time. */
  update(eye: Vec3, facingRad: number, nowMs: number): void;
  /** The user was moved: hang it up anew. */
  moved(): void;
}

/** A board, hidden. */
export function createBoard(): Board {
  const panel = createPanel("message-board", WIDTH, HEIGHT);
  let due = false;
  let untilMs = Number.NEGATIVE_INFINITY;
  let hungFacingRad = 0;
  return {
    panel,
    show(text, tone, stays, nowMs) {
      panel.draw((context) => drawBoard(context, text, tone));
      untilMs = stays ? Number.POSITIVE_INFINITY : nowMs + LASTS_MS;
      due = true;
    },
    update(eye, facingRad, nowMs) {
      if (nowMs >= untilMs) {
        panel.hide();
        due = false;
        return;
      }
      const isBeside = Math.abs(wrapAngle(facingRad - hungFacingRad)) > BESIDE_RAD;
      // It hangs still while it is read: only news brings it round, and only where the user looks elsewhere.
      if (due && (panel.pose === null || isBeside)) {
        panel.moveTo(panelBefore(eye, facingRad, BOARD_AWAY_M, BELOW_M));
        hungFacingRad = facingRad;
      }
      due = false;
    },
    moved() {
      due = panel.pose !== null;
      panel.hide();
    },
  };
}

function drawBoard(context: CanvasRenderingContext2D, text: string, tone: Tone): void {
  drawPlate(context, WIDTH, HEIGHT, "rgba(16, 20, 26, 0.92)", tone === "warning" ? "#ff8a3c" : "#8fd3ff");
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.fillStyle = tone === "warning" ? "#ff8a3c" : "#8fd3ff";
  context.font = `700 110px ${FONT}`;
  context.fillText(tone === "warning" ? "!" : "i", 64, HEIGHT / 2);
  context.fillStyle = "#f2f5f8";
  context.font = `500 ${BOARD_FONT}px ${FONT}`;
  const lines = wrapText(text, WIDTH - 220, (line) => context.measureText(line).width).slice(0, 4);
  const top = HEIGHT / 2 - ((lines.length - 1) * LINE) / 2;
  for (const [k, line] of lines.entries()) {
    context.fillText(line, 150, top + k * LINE, WIDTH - 200);
  }
}
