/**
 * How ready the place is that somebody points at, from the stream's events.
 *
 * The service answers an aim by saying how much it sends ahead, then sends it, then says that all of it was sent.
 */

import type { StreamEvent } from "../core/types.ts";

export interface Readiness {
  /** Bytes announced for the newest aim; null until the service has answered. */
  announcedBytes: number | null;
  arrivedBytes: number;
  isDone: boolean;
}

/** Before the service has answered any aim. */
export function newReadiness(): Readiness {
  return { announcedBytes: null, arrivedBytes: 0, isDone: false };
}

/** A new aim begins, or the old one is over: what was said of it counts no more. */
export function resetReadiness(readiness: Readiness): void {
  readiness.announcedBytes = null;
  readiness.arrivedBytes = 0;
  readiness.isDone = false;
}

/** Take an event of the stream; those that are not about an aim change nothing. */
export function noteEvent(readiness: Readiness, event: StreamEvent): void {
  if (event.type === "prefetching") {
    readiness.announcedBytes = event.bytes;
    readiness.arrivedBytes = 0;
    readiness.isDone = event.bytes === 0;
  } else if (event.type === "arrived" && event.landing === null) {
    readiness.arrivedBytes += event.facts.length;
  } else if (event.type === "prefetched") {
    readiness.isDone = true;
  }
}

/** 0 to 1. Below 1 until the service has said that all was sent. */
export function readinessOf(readiness: Readiness): number {
  if (readiness.isDone) {
    return 1;
  }
  if (readiness.announcedBytes === null || readiness.announcedBytes <= 0) {
    return 0;
  }
  return Math.min(0.98, readiness.arrivedBytes / readiness.announcedBytes);
}
