import { expect, it } from "vitest";
import { hintsFor, seenHints } from "../src/app/viewer/hints.ts";

it("takes what the browser kept for a number of hints, and anything else for none", () => {
  expect(seenHints(null, 3)).toBe(0);
  expect(seenHints("2", 3)).toBe(2);
  expect(seenHints("17", 3)).toBe(3);
  for (const kept of ["-1", "1.5", "yes", "NaN"]) expect(seenHints(kept, 3)).toBe(0);
});

it("tells three, in the words of what points", () => {
  expect(hintsFor(false).map(({ text }) => text)).toHaveLength(3);
  expect(hintsFor(true)[1]!.text).toMatch(/^Tap/);
  expect(hintsFor(false)[1]!.text).toMatch(/^Click/);
});
