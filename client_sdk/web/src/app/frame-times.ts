/**
 * How long frames take. PURE.
 *
 * The page draws only when something changes, so the time between two frames says nothing where it rested in between: such
 * a gap is not a frame, and is left out.
 */

/** The newest frames, oldest first, milliseconds. */
export interface FrameTimes {
  /** A frame began at `nowMs`; `rested` says that the one before it did not ask for this one. */
  begin(nowMs: number, rested: boolean): void;
  readonly recent: readonly number[];
}

/** A summary of recent frames. */
export interface FrameSummary {
  readonly count: number;
  readonly medianMs: number;
  readonly p95Ms: number;
  readonly maxMs: number;
}

/** Frames that are kept: four seconds at 60 Hz. */
export const KEPT_FRAMES = 240;

/** Start counting. */
export function createFrameTimes(): FrameTimes {
  const recent: number[] = [];
  let lastMs: number | null = null;
  return {
    recent,
    begin(nowMs, rested) {
      if (lastMs !== null && !rested && nowMs > lastMs) {
        recent.push(nowMs - lastMs);
        if (recent.length > KEPT_FRAMES) recent.shift();
      }
      lastMs = nowMs;
    },
  };
}

/** Summarise; null without frames. */
export function summariseFrames(recent: readonly number[]): FrameSummary | null {
  if (recent.length === 0) return null;
  const sorted = recent.toSorted((a, b) => a - b);
  const at = (share: number) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))]!;
  return { count: sorted.length, medianMs: at(0.5), p95Ms: at(0.95), maxMs: sorted[sorted.length - 1]! };
}
