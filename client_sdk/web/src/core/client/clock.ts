/**
 * Milliseconds since 1970 by the monotonic clock of this browsing context: comparable between the page and its workers,
 * whose `performance.now()` begin at different moments.
 */
export function sharedNowMs(): number {
  return performance.timeOrigin + performance.now();
}
