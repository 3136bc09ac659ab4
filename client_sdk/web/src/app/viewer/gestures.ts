/** What hands do on the canvas, in words: drag, pan, pinch, tap, press. Mouse, pen and touch alike. */

/** Who is told. Places are CSS pixels of the canvas. */
export interface GestureTarget {
  drag(dx: number, dy: number): void;
  pan(dx: number, dy: number): void;
  twist(degrees: number): void;
  /** `factor` below 1 brings nearer what is at (x, y). */
  zoom(factor: number, x: number, y: number): void;
  tap(x: number, y: number): void;
  /** Held still: the aim begins, and ends with `pressEnd`. False where there is nothing to aim at. */
  press(x: number, y: number): boolean;
  /** Let go, or cancelled: by a drag, a second finger, the wheel, the system. */
  pressEnd(cancelled: boolean): void;
  /** A contact goes down that paints: then it neither drags, presses nor taps, until it is lifted. */
  paint(x: number, y: number): boolean;
  paintMove(x: number, y: number): void;
  paintEnd(cancelled: boolean): void;
}

/** Maximum movement of a tap or a press, pixels; a larger movement is a drag. */
const STILL_PX = 8;
const PRESS_MS = 450;

interface Contact {
  readonly startX: number;
  readonly startY: number;
  x: number;
  y: number;
  moved: boolean;
}

/**
 * Listen on the canvas; returns how to stop.
 *
 * One contact is a tap, a press (held still), or a drag as soon as it moves, even after it was held still: a page that draws
 * slowly receives the movement late, and a drag must never land. Two are a pinch. A gesture that has had two contacts ends
 * only when both are lifted.
 */
export function listenToGestures(canvas: HTMLElement, target: GestureTarget): () => void {
  const contacts = new Map<number, Contact>();
  let pressTimer: number | null = null;
  let pressed = false;
  let paints = false;
  let pans = false;
  /** Two fingers were down: lifting one of them is not a tap, nor the start of a drag. */
  let wasPinch = false;
  const abort = new AbortController();
  const options = { signal: abort.signal };

  const canvasPointOf = (event: MouseEvent) => {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };

  function isStill({ startX, startY }: Contact, x: number, y: number): boolean {
    return Math.hypot(x - startX, y - startY) < STILL_PX;
  }

  function stopPressTimer(): void {
    if (pressTimer !== null) window.clearTimeout(pressTimer);
    pressTimer = null;
  }

  function endPress(cancelled: boolean): void {
    stopPressTimer();
    if (pressed) target.pressEnd(cancelled);
    pressed = false;
  }

  function endPaint(cancelled: boolean): void {
    if (paints) target.paintEnd(cancelled);
    paints = false;
  }

  canvas.addEventListener(
    "pointerdown",
    (event) => {
      // Moves are told to the canvas even where they leave it.
      canvas.setPointerCapture(event.pointerId);
      const { x, y } = canvasPointOf(event);
      contacts.set(event.pointerId, { startX: x, startY: y, x, y, moved: false });
      if (contacts.size === 1) {
        wasPinch = false;
        pans = event.button === 1 || event.button === 2 || event.shiftKey || event.ctrlKey;
        paints = !pans && target.paint(x, y);
        if (!pans && !paints) {
          pressTimer = window.setTimeout(() => {
            pressed = target.press(x, y);
          }, PRESS_MS);
        }
      } else {
        wasPinch = true;
        endPress(true);
        endPaint(true);
      }
    },
    options,
  );

  canvas.addEventListener(
    "pointermove",
    (event) => {
      const contact = contacts.get(event.pointerId);
      if (contact === undefined) return;
      const { x, y } = canvasPointOf(event);
      const dx = x - contact.x;
      const dy = y - contact.y;
      if (contacts.size === 2) {
        pinch(event.pointerId, contact, x, y);
        return;
      }
      if (paints) {
        target.paintMove(x, y);
        return;
      }
      if (!contact.moved && isStill(contact, x, y)) return;
      endPress(true);
      contact.moved = true;
      contact.x = x;
      contact.y = y;
      if (wasPinch) return;
      if (pans) target.pan(dx, dy);
      else target.drag(dx, dy);
    },
    options,
  );

  /** Both fingers: their middle pans, their distance zooms, their direction turns. */
  function pinch(id: number, contact: Contact, x: number, y: number): void {
    const otherContact = [...contacts].find(([otherId]) => otherId !== id)?.[1];
    if (otherContact === undefined) return;
    const before = { x: contact.x - otherContact.x, y: contact.y - otherContact.y };
    const after = { x: x - otherContact.x, y: y - otherContact.y };
    const middleX = (x + otherContact.x) / 2;
    const middleY = (y + otherContact.y) / 2;
    target.pan((x - contact.x) / 2, (y - contact.y) / 2);
    const beforeSize = Math.hypot(before.x, before.y);
    const afterSize = Math.hypot(after.x, after.y);
    if (beforeSize > 10 && afterSize > 10) {
      target.zoom(beforeSize / afterSize, middleX, middleY);
      const turn = Math.atan2(before.x * after.y - before.y * after.x, before.x * after.x + before.y * after.y);
      target.twist((-turn * 180) / Math.PI);
    }
    contact.x = x;
    contact.y = y;
  }

  function lift(event: PointerEvent, cancelled: boolean): void {
    const contact = contacts.get(event.pointerId);
    if (contact === undefined) return;
    contacts.delete(event.pointerId);
    if (contacts.size > 0) return;
    if (paints) {
      endPaint(cancelled);
      return;
    }
    // The browser may leave out the last movement: compare where the contact is lifted as well.
    const { x, y } = canvasPointOf(event);
    const isDrag = cancelled || contact.moved || !isStill(contact, x, y);
    if (pressed) {
      endPress(isDrag);
      return;
    }
    stopPressTimer();
    if (!isDrag && !wasPinch && !pans) target.tap(contact.startX, contact.startY);
  }

  canvas.addEventListener("pointerup", (event) => lift(event, false), options);
  canvas.addEventListener("pointercancel", (event) => lift(event, true), options);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault(), options);
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      // Turning the wheel while a button is down means looking around.
      for (const contact of contacts.values()) contact.moved = true;
      endPress(true);
      const { x, y } = canvasPointOf(event);
      // Lines and pages to pixels, as browsers scroll; a notch of a wheel is about a tenth nearer.
      const pixels = event.deltaY * (event.deltaMode === 1 ? 32 : event.deltaMode === 2 ? 400 : 1);
      target.zoom(Math.exp(Math.max(-240, Math.min(240, pixels)) * 0.0014), x, y);
    },
    { ...options, passive: false },
  );

  return () => {
    stopPressTimer();
    abort.abort();
  };
}
