/** Fade and vignette as functions of time. Milliseconds in, 0 to 1 out. */

/** How long a blink takes to close, and to open again. A human blink closes in about 100 ms and opens in 150 to 200. */
export const FADE_OUT_MS = 100;
export const FADE_IN_MS = 150;
/** How long the vignette takes to close before a snap turn, and to open after it. */
export const VIGNETTE_CLOSE_MS = 50;
export const VIGNETTE_OPEN_MS = 220;

/** 0 at or before 0, 1 at or after 1, smooth between. */
export function smoothStep(t: number): number {
  const clamped = Math.min(1, Math.max(0, t));
  return clamped * clamped * (3 - 2 * clamped);
}

/** How black a blink is, so long after it began to close. */
export function fadeOut(elapsedMs: number): number {
  return smoothStep(elapsedMs / FADE_OUT_MS);
}

/** How black a blink is, so long after it began to open. */
export function fadeIn(elapsedMs: number): number {
  return 1 - smoothStep(elapsedMs / FADE_IN_MS);
}

/** How far the vignette is closed, so long after it began; it is closed from `closeMs` on, and opens after `turnedMs`. */
export function vignetteAt(elapsedMs: number, sinceTurnMs: number | null): number {
  if (sinceTurnMs === null) {
    return smoothStep(elapsedMs / VIGNETTE_CLOSE_MS);
  }
  return 1 - smoothStep(sinceTurnMs / VIGNETTE_OPEN_MS);
}
