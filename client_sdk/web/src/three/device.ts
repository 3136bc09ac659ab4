/** Limits of this device, as far as a page can tell without asking for more rights. */

import { budgetsFor, type DeviceBudgets, type DeviceClass } from "../core/budgets.ts";

/** A headset's own browser, a phone or tablet, or a desktop computer. */
export function deviceClass(): DeviceClass {
  if (/OculusBrowser|Quest|PicoBrowser|VisionOS/i.test(navigator.userAgent)) return "headset";
  const isTouch = matchMedia("(pointer: coarse)").matches;
  return isTouch && Math.min(screen.width, screen.height) < 900 ? "phone" : "desktop";
}

/** Limits of a class of devices with the memory of this one. */
export function deviceBudgets(device: DeviceClass = deviceClass()): DeviceBudgets {
  // Chromium alone tells it, in steps: enough to notice that there is little.
  const { deviceMemory } = navigator as { deviceMemory?: number };
  return budgetsFor(device, deviceMemory);
}
