/** What a stream tells, told to a residency. PURE. */

import type { Residency } from "./residency.ts";
import type { StreamEvent } from "./types.ts";

/** Tell a residency what the stream says of landings and segments; every event may be passed. */
export function passOn(event: StreamEvent, residency: Residency): void {
  switch (event.type) {
    case "planned":
      residency.planned(event.plan);
      break;
    case "arrived":
      residency.arrived(event.key, event.bytes, event.landing);
      break;
    case "degraded":
      residency.degraded(event.landing, event.segments, event.hidden);
      break;
    case "ready":
      residency.ready(event.landing, event.visible, event.hidden, event.missing, event.elapsedMs, event.payloadBytes);
      break;
    case "refused":
      if (event.landing !== null) {
        residency.refused(event.landing, event.message);
      }
      break;
    default:
      break;
  }
}
