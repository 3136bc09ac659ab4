/** What kind of machine the page runs on, as far as a page can tell without asking for more rights. */

import { budgetsFor, type DeviceBudgets, type DeviceClass } from "../core/index.ts";

/** A headset's own browser, a phone or tablet, or a desk. */
export function deviceClass(): DeviceClass {
  if (/OculusBrowser|Quest|PicoBrowser|VisionOS/i.test(navigator.userAgent)) return "headset";
  return isTouch() && Math.min(window.screen.width, window.screen.height) < 900 ? "phone" : "desktop";
}

/** Whether fingers point, not a mouse. */
export function isTouch(): boolean {
  return window.matchMedia("(pointer: coarse)").matches;
}

/** The bounds of this machine. */
export function deviceBudgets(): DeviceBudgets {
  // Chromium alone tells it, in steps and up to 8 (32 from 2026): enough to notice that there is little.
  const { deviceMemory } = navigator as { deviceMemory?: number };
  return budgetsFor(deviceClass(), deviceMemory);
}

/** Whether the user asked the system for less motion. Asked each time: the setting may change. */
export function prefersLessMotion(): boolean {
  return window.matchMedia("(prefers-reduced-motion: reduce)").matches;
}
