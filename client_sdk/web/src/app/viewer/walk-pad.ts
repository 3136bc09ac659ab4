/** A pad for walking on a touch screen: the thumb's place on it is the direction, and how fast. */

import { h } from "../dom.ts";

/** The touch pad, and where the thumb is on it; all 0 when no thumb is. */
export interface WalkPad {
  readonly element: HTMLElement;
  /** Each from -1 to 1. */
  readonly forward: number;
  readonly right: number;
  readonly fast: boolean;
}

/** Make it; `changed` is called while the thumb moves. */
export function createWalkPad(changed: () => void): WalkPad {
  const knob = h("div", { class: "pad-knob" });
  // Not for keyboards or screen readers: the keys that walk are told in the help.
  const element = h("div", { id: "walk-pad", class: "walk-pad", "aria-hidden": "true" }, knob);
  let forward = 0;
  let right = 0;

  function follow(event: PointerEvent): void {
    const box = element.getBoundingClientRect();
    const half = box.width / 2;
    let x = (event.clientX - box.left - half) / half;
    let y = (event.clientY - box.top - half) / half;
    const size = Math.hypot(x, y);
    if (size > 1) {
      x /= size;
      y /= size;
    }
    // A resting thumb does not creep.
    const isStill = Math.hypot(x, y) < 0.15;
    right = isStill ? 0 : x;
    forward = isStill ? 0 : -y;
    knob.style.transform = `translate(${x * half * 0.6}px, ${y * half * 0.6}px)`;
    changed();
  }

  function release(): void {
    forward = 0;
    right = 0;
    knob.style.transform = "";
    changed();
  }

  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    follow(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (element.hasPointerCapture(event.pointerId)) follow(event);
  });
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);

  return {
    element,
    get forward() {
      return forward;
    },
    get right() {
      return right;
    },
    get fast() {
      return Math.hypot(forward, right) > 0.95;
    },
  };
}
