/**
 * How long to wait before connecting again.
 *
 * 0.5 s, then twice as long each time up to 30 s, each wait multiplied by a random
 * number in [0.5, 1], so that the clients of a restarted server do not all come back in the same moment.
 *
 * PURE; chance is an argument.
 */

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 30_000;

/**
 * Milliseconds to wait before an attempt.
 *
 * @param attempt - 0 for the first one after the loss.
 * @param chance - a number in [0, 1], as of `Math.random()`.
 */
export function waitMs(attempt: number, chance: number): number {
  const doubled = FIRST_WAIT_MS * 2 ** Math.min(attempt, 16);
  return Math.min(LONGEST_WAIT_MS, doubled) * (0.5 + 0.5 * chance);
}
