/** The brush: strokes on the ground that teach names, sent to the service, and what they taught. */

import { fetchTaught, listStrokes, paintStroke, takeBackStroke } from "../../core/extras/strokes.ts";
import type { HttpOptions } from "../../core/scene/http.ts";
import type { PaintedStroke, TaughtGround, TaughtPicture, Vec3 } from "../../core/types.ts";
import type { GroundHit } from "../../three/types.ts";
import { type BrushCard, createBrushCard } from "./brush-card.ts";
import type { BrushLines, DrawnStroke } from "./brush-lines.ts";
import type { Ray } from "./camera-desk.ts";
import type { ViewerState, ViewerStore } from "./state.ts";

/** What the brush sees, and what it sets off. */
export interface BrushOptions {
  readonly store: ViewerStore;
  readonly sceneUrl: string;
  readonly lines: BrushLines;
  http(): HttpOptions;
  rayAt(x: number, y: number): Ray;
  cast(ray: Ray): GroundHit | null;
  /** The highest ground there; null beside the scene. */
  highest(x: number, z: number): number | null;
  /** Lay what was taught over the ground; null takes it away. */
  setTaught(picture: TaughtPicture | null): void;
  /** Look at a place. */
  lookAt(place: Vec3): void;
  announce(text: string): void;
  /** Something is to be drawn. */
  changed(): void;
}

/** The card, and what gestures do under the tool. Points are CSS pixels of the canvas. */
export interface Brush {
  readonly card: HTMLElement;
  press(x: number, y: number): boolean;
  move(x: number, y: number): void;
  end(cancelled: boolean): void;
  /** Take back the newest stroke of one's own. */
  undo(): void;
  dispose(): void;
}

/** As the service bounds a stroke. */
const MAX_PLACES = 256;
/** Places of a stroke are so far apart, as a share of its width. */
const SPACING = 0.35;
const MIN_SPACING_M = 0.05;
/** Places of strokes that are drawn, newest strokes first: each asks the ground for its height. */
const MAX_DRAWN_PLACES = 4000;
/** The service is asked so often while an answer is due, and else. */
const WAITING_MS = 700;
const IDLE_MS = 4000;
/** So long without an answer, and the card says what answers. */
const NOBODY_MS = 20_000;

/** Make the brush; it asks the service only while it is the tool. */
export function createBrush(options: BrushOptions): Brush {
  const { store, sceneUrl, lines, http, announce } = options;
  const abort = new AbortController();
  const heights = new Map<string, readonly Vec3[]>();
  let strokes: readonly PaintedStroke[] = [];
  let revision = "";
  let taught: TaughtGround | null = null;
  let waitsSinceMs: number | null = null;
  let painting: { points: Vec3[]; spacingM: number } | null = null;
  let timer: number | undefined;
  /** Answers of requests that were sent before a change of one's own are of an older state. */
  let changes = 0;

  const card: BrushCard = createBrushCard({
    undo,
    shown: () => show(),
    nextPlace(index) {
      const places = taught?.picture?.places ?? [];
      const place = places[index % Math.max(1, places.length)];
      if (place === undefined) return;
      const [x, z] = place.position;
      options.lookAt([x, options.highest(x, z) ?? 0, z]);
      announce(`${place.likeliest}, or ${place.other}?`);
    },
  });

  async function ask(): Promise<void> {
    window.clearTimeout(timer);
    const changesBefore = changes;
    try {
      const request = { ...http(), signal: abort.signal };
      const [list, answer] = await Promise.all([listStrokes(sceneUrl, request), fetchTaught(sceneUrl, request)]);
      if (abort.signal.aborted) return;
      if (changesBefore === changes) ({ strokes, revision } = list);
      take(answer);
      card.setFault(null);
    } catch (error) {
      if (abort.signal.aborted) return;
      card.setFault(error instanceof Error ? error.message : String(error));
    }
    show();
    if (store.get().tool !== "brush") return;
    timer = window.setTimeout(() => void ask(), waitsSinceMs === null ? IDLE_MS : WAITING_MS);
  }

  function take(answer: TaughtGround | null): void {
    const isNew = answer?.revision !== taught?.revision || answer?.state !== taught?.state;
    taught = answer;
    const isDue = revision !== "" && strokes.length > 0 && answer?.revision !== revision;
    if (!isDue) waitsSinceMs = null;
    else waitsSinceMs ??= performance.now();
    if (isNew && answer?.state === "taught") announce("The strokes are answered");
  }

  function show(): void {
    const isTool = store.get().tool === "brush";
    const picture = taught?.picture ?? null;
    options.setTaught(isTool && card.showsTaught ? picture : null);
    lines.object.visible = isTool;
    card.element.hidden = !isTool;
    lines.set([...drawnStrokes(), ...(painting === null ? [] : [inHand(painting.points)])]);
    const isLate = waitsSinceMs !== null && performance.now() - waitsSinceMs > NOBODY_MS;
    card.show({ strokes, taught, waits: waitsSinceMs === null ? "no" : isLate ? "long" : "yes" });
    options.changed();
  }

  function inHand(points: readonly Vec3[]): DrawnStroke {
    const { colour, widthM } = card.brush;
    return { colour, widthM, points: points.length === 1 ? [points[0]!, beside(points[0]!)] : points };
  }

  function drawnStrokes(): DrawnStroke[] {
    const drawn: DrawnStroke[] = [];
    let left = MAX_DRAWN_PLACES;
    for (const { id, colour, widthM, line } of [...strokes].reverse()) {
      left -= line.length;
      if (left < 0) break;
      let points = heights.get(id);
      if (points === undefined) {
        points = line.map(([x, z]): Vec3 => [x, options.highest(x, z) ?? 0, z]);
        heights.set(id, points);
      }
      drawn.push({ colour, widthM, points });
    }
    return drawn.reverse();
  }

  async function paint(points: readonly Vec3[]): Promise<void> {
    const { name, colour, widthM } = card.brush;
    const line = points.map(([x, , z]) => [x, z] as const);
    if (line.length === 1) line.push(line[0]!);
    changes += 1;
    waitsSinceMs = performance.now();
    try {
      const answer = await paintStroke(sceneUrl, { name, colour, widthM, line }, { ...http(), signal: abort.signal });
      heights.set(answer.stroke.id, points.length === 1 ? [points[0]!, beside(points[0]!)] : points);
      ({ revision } = answer);
      changes += 1;
      strokes = [...strokes, answer.stroke];
      card.setFault(null);
    } catch (error) {
      if (abort.signal.aborted) return;
      waitsSinceMs = null;
      card.setFault(`Not painted: ${error instanceof Error ? error.message : String(error)}`);
    }
    show();
    void ask();
  }

  function undo(): void {
    const own = strokes.findLast(({ isOwn }) => isOwn);
    if (own === undefined) return;
    changes += 1;
    strokes = strokes.filter(({ id }) => id !== own.id);
    show();
    takeBackStroke(sceneUrl, own.id, { ...http(), signal: abort.signal })
      .then((now) => {
        revision = now;
        changes += 1;
        announce(`Took back a stroke of ${own.name}`);
      })
      .catch((error: unknown) => card.setFault(`Not taken back: ${error instanceof Error ? error.message : ""}`))
      .finally(() => void ask());
  }

  function groundAt(x: number, y: number): Vec3 | null {
    return options.cast(options.rayAt(x, y))?.position ?? null;
  }

  function toolChanged(state: ViewerState, before: ViewerState): void {
    if (state.tool === before.tool || (state.tool !== "brush" && before.tool !== "brush")) return;
    if (state.tool === "brush") void ask();
    else window.clearTimeout(timer);
    show();
  }

  const stop = store.subscribe(toolChanged);
  return {
    card: card.element,
    press(x, y) {
      if (store.get().tool !== "brush") return false;
      if (!card.isNamed()) return true;
      const place = groundAt(x, y);
      if (place === null) return false;
      painting = { points: [place], spacingM: Math.max(MIN_SPACING_M, card.brush.widthM * SPACING) };
      show();
      return true;
    },
    move(x, y) {
      if (painting === null) return;
      const place = groundAt(x, y);
      const last = painting.points.at(-1)!;
      if (place === null || Math.hypot(place[0] - last[0], place[2] - last[2]) < painting.spacingM) return;
      painting.points.push(place);
      if (painting.points.length >= MAX_PLACES) {
        // Every second place, and from now on twice as far apart: a stroke has an end, a hand has none.
        painting.points = painting.points.filter((_, index) => index % 2 === 0);
        painting.spacingM *= 2;
      }
      show();
    },
    end(cancelled) {
      const points = painting?.points ?? [];
      painting = null;
      if (cancelled || points.length === 0) show();
      else void paint(points);
    },
    undo,
    dispose() {
      stop();
      abort.abort();
      window.clearTimeout(timer);
      lines.dispose();
    },
  };
}

/** A place so near that both are one. */
function beside([x, y, z]: Vec3): Vec3 {
  return [x + 0.01, y, z];
}
