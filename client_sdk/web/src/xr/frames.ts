/** Frame times in a ring of fixed size: no allocation while measuring, sorted only when asked. */

export interface FrameTimes {
  readonly ms: Float32Array;
  count: number;
}

/** About three seconds at 72 to 90 Hz. */
const KEPT = 240;

export interface TimeSummary {
  readonly medianMs: number;
  readonly p99Ms: number;
  readonly maxMs: number;
}

/** An empty ring. */
export function newFrameTimes(): FrameTimes {
  return { ms: new Float32Array(KEPT), count: 0 };
}

/** Note a frame's time, over the oldest once the ring is full: no memory is taken in a frame. */
export function addTime(times: FrameTimes, ms: number): void {
  times.ms[times.count % KEPT] = ms;
  times.count += 1;
}

/** Of the last 240; zeros where there was none. */
export function summarise(times: FrameTimes): TimeSummary {
  const sortedMs = times.ms.slice(0, Math.min(times.count, KEPT)).sort();
  const at = (share: number): number =>
    sortedMs[Math.min(sortedMs.length - 1, Math.floor(share * sortedMs.length))] ?? 0;
  return { medianMs: at(0.5), p99Ms: at(0.99), maxMs: at(1) };
}
