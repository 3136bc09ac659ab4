/** What the page and the headset are told of the newest landing. PURE. */

import type { Residency } from "../core/residency.ts";
import type { LandingPhase, LandingStatus } from "./types.ts";

/** @param canSwap False while nothing can be shown whatever is there: no graphics context, or files of an old version. */
export function statusOf(residency: Residency, canSwap: boolean): LandingStatus {
  const landing = residency.newest;
  return {
    landing: landing?.landing ?? 0,
    phase: phaseOf(residency, canSwap),
    position: landing?.position ?? [0, 0, 0],
    radiusM: landing?.radiusM ?? 0,
    fraction: residency.fraction(),
    plan: landing?.plan ?? null,
    readyMs: landing?.readyMs ?? null,
    presentableMs: landing?.presentableMs ?? null,
    payloadBytes: landing?.payloadBytes ?? 0,
    missing: landing?.missing ?? [],
    refusal: landing?.refusal ?? null,
  };
}

function phaseOf(residency: Residency, canSwap: boolean): LandingPhase {
  const landing = residency.newest;
  if (!landing) {
    return "idle";
  }
  if (landing.refusal !== null) {
    return "refused";
  }
  if (landing.swapped === "full") {
    return "shown";
  }
  const presentable = canSwap ? residency.presentable() : null;
  if (presentable) {
    return presentable === "full" ? "presentable" : "degraded-presentable";
  }
  return landing.plan ? "streaming" : "planning";
}
