/** What kind of machine the page runs on, as far as a page can tell without asking for more rights. */

/** Whether fingers point, not a mouse. */
export function isTouch(): boolean {
  return window.matchMedia("(pointer: coarse)").matches;
}

/** Whether the user asked the system for less motion. Asked each time: the setting may change. */
export function prefersLessMotion(): boolean {
  return window.matchMedia("(prefers-reduced-motion: reduce)").matches;
}
