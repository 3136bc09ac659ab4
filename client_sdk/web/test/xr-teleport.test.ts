import { describe, expect, test } from "vitest";
import type { LandingPhase } from "../src/three/types.ts";
import { FADE_IN_MS, FADE_OUT_MS, fadeIn, fadeOut, smoothStep } from "../src/xr/curves.ts";
import {
  advance,
  beginAim,
  beginBlack,
  cancelAim,
  commit,
  newTeleport,
  phaseOf,
  releaseAim,
  shown,
  type Target,
  type Teleport,
} from "../src/xr/teleport.ts";

const target: Target = { position: [1, 2, 3], turnRad: 0, facingRad: null };
const FRAME_MS = 1000 / 90;

/** Run frames, doing what a frame does; returns what happened in order. */
function run(
  teleport: Teleport,
  fromMs: number,
  untilMs: number,
  status: { landing: number; phase: LandingPhase },
  degraded = false,
): { timeMs: number; opacity: number; step: string }[] {
  const steps: { timeMs: number; opacity: number; step: string }[] = [];
  for (let timeMs = fromMs; timeMs < untilMs; timeMs += FRAME_MS) {
    const step = advance(teleport, timeMs, status);
    steps.push({ timeMs, opacity: teleport.opacity, step });
    if (step === "show") {
      shown(teleport, true, degraded);
      status.phase = degraded ? "streaming" : "shown";
    }
  }
  return steps;
}

describe("curves", () => {
  test("fade out and in are each other's mirror, and end exactly", () => {
    expect(fadeOut(0)).toBe(0);
    expect(fadeOut(FADE_OUT_MS)).toBe(1);
    expect(fadeOut(5000)).toBe(1);
    expect(fadeIn(0)).toBe(1);
    expect(fadeIn(FADE_IN_MS)).toBe(0);
    expect(fadeIn(5000)).toBe(0);
    expect(smoothStep(0.5)).toBe(0.5);
    for (let ms = 1; ms < FADE_OUT_MS; ms++) {
      expect(fadeOut(ms)).toBeGreaterThan(fadeOut(ms - 1));
    }
  });
});

describe("a landing", () => {
  test("goes through idle, aiming, committed, blinking, idle", () => {
    const teleport = newTeleport();
    expect(phaseOf(teleport)).toBe("idle");
    expect(beginAim(teleport, 1)).toBe(true);
    expect(phaseOf(teleport)).toBe("aiming");
    expect(releaseAim(teleport, 1)).toBe(true);
    commit(teleport, 7, target);
    expect(phaseOf(teleport)).toBe("committed");
    expect(run(teleport, 0, 500, { landing: 7, phase: "streaming" }).every((each) => each.opacity === 0)).toBe(true);
    expect(advance(teleport, 500, { landing: 7, phase: "presentable" })).toBe("none");
    expect(phaseOf(teleport)).toBe("blinking");
    run(teleport, 510, 1000, { landing: 7, phase: "presentable" });
    expect(phaseOf(teleport)).toBe("idle");
    expect(teleport.opacity).toBe(0);
  });

  test("is shown once, at full black, and the frame after it is black too", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    const frames = run(teleport, 0, 600, { landing: 1, phase: "presentable" });
    const shows = frames.filter((each) => each.step === "show");
    expect(shows).toHaveLength(1);
    const index = frames.indexOf(shows[0]!);
    expect(shows[0]!.opacity).toBe(1);
    expect(frames[index + 1]!.opacity).toBe(1);
    expect(frames[index + 2]!.opacity).toBeLessThan(1);
    expect(shows[0]!.timeMs).toBeGreaterThanOrEqual(FADE_OUT_MS);
    expect(shows[0]!.timeMs).toBeLessThan(FADE_OUT_MS + 2 * FRAME_MS);
    expect(frames.at(-1)!.opacity).toBe(0);
  });

  test("opens only after a long frame of the swap is over", () => {
    const teleport = newTeleport();
    const status = { landing: 1, phase: "presentable" as LandingPhase };
    commit(teleport, 1, target);
    advance(teleport, 0, status);
    expect(advance(teleport, 120, status)).toBe("show");
    shown(teleport, true, false);
    // 400 ms went by in the driver.
    advance(teleport, 520, status);
    expect(teleport.opacity).toBe(1);
    advance(teleport, 520 + FADE_IN_MS / 2, status);
    expect(teleport.opacity).toBeCloseTo(0.5);
  });

  test("past the deadline is shown by a blink that moves, the rest by a second that does not", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    const first = run(teleport, 0, 600, { landing: 1, phase: "degraded-presentable" }, true);
    expect(first.filter((each) => each.step === "show")).toHaveLength(1);
    expect(teleport.pending).toMatchObject({ landing: 1, moved: true });
    expect(phaseOf(teleport)).toBe("committed");
    // The same set again is no reason to blink.
    expect(
      run(teleport, 600, 900, { landing: 1, phase: "degraded-presentable" }).some((each) => each.opacity > 0),
    ).toBe(false);
    const second = run(teleport, 1000, 1600, { landing: 1, phase: "presentable" });
    expect(second.filter((each) => each.step === "show")).toHaveLength(1);
    expect(teleport.pending).toBeNull();
  });

  test("superseded before it came: only the new one is shown", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    run(teleport, 0, 100, { landing: 1, phase: "streaming" });
    commit(teleport, 2, target);
    expect(run(teleport, 100, 300, { landing: 1, phase: "presentable" }).some((each) => each.step === "show")).toBe(
      false,
    );
    expect(run(teleport, 300, 700, { landing: 2, phase: "presentable" }).some((each) => each.step === "show")).toBe(
      true,
    );
  });

  test("superseded within the blink: it opens on the old place, and the new landing still waits", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    advance(teleport, 0, { landing: 1, phase: "presentable" });
    advance(teleport, 50, { landing: 1, phase: "presentable" });
    commit(teleport, 2, target);
    expect(advance(teleport, 110, { landing: 2, phase: "planning" })).toBe("show");
    shown(teleport, false, false);
    run(teleport, 120, 600, { landing: 2, phase: "planning" });
    expect(teleport.opacity).toBe(0);
    expect(teleport.pending).toMatchObject({ landing: 2, moved: false });
  });

  test("refused: nothing goes black, the landing is off", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    expect(advance(teleport, 0, { landing: 1, phase: "refused" })).toBe("refused");
    expect(phaseOf(teleport)).toBe("idle");
    expect(advance(teleport, 11, { landing: 1, phase: "refused" })).toBe("none");
    expect(teleport.opacity).toBe(0);
  });

  test("refused while the view closes: it opens again without a jump", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    advance(teleport, 0, { landing: 1, phase: "presentable" });
    advance(teleport, 60, { landing: 1, phase: "presentable" });
    const closed = teleport.opacity;
    expect(advance(teleport, 60, { landing: 1, phase: "refused" })).toBe("refused");
    advance(teleport, 60, { landing: 1, phase: "refused" });
    expect(teleport.opacity).toBeCloseTo(closed, 6);
    const rest = run(teleport, 71, 400, { landing: 1, phase: "refused" });
    expect(rest.some((each) => each.step === "show")).toBe(false);
    expect(teleport.opacity).toBe(0);
  });

  test("swapped by somebody else: the move is still due", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    expect(run(teleport, 0, 300, { landing: 1, phase: "shown" }).some((each) => each.step === "show")).toBe(true);
  });

  test("the rest swapped by somebody else: nothing is left to do", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    run(teleport, 0, 600, { landing: 1, phase: "degraded-presentable" }, true);
    expect(advance(teleport, 700, { landing: 1, phase: "shown" })).toBe("none");
    expect(phaseOf(teleport)).toBe("idle");
  });
});

describe("an aim", () => {
  test("belongs to one hand", () => {
    const teleport = newTeleport();
    expect(beginAim(teleport, 0)).toBe(true);
    expect(beginAim(teleport, 1)).toBe(false);
    expect(releaseAim(teleport, 1)).toBe(false);
    expect(cancelAim(teleport, 1)).toBe(false);
    expect(phaseOf(teleport)).toBe("aiming");
    expect(cancelAim(teleport, null)).toBe(true);
    expect(phaseOf(teleport)).toBe("idle");
    expect(cancelAim(teleport, null)).toBe(false);
  });

  test("holds back the blink of the landing before it; its cancel lets that go on", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    beginAim(teleport, 0);
    const steps = run(teleport, 0, 400, { landing: 1, phase: "presentable" });
    expect(steps.every((each) => each.opacity === 0 && each.step === "none")).toBe(true);
    cancelAim(teleport, 0);
    expect(run(teleport, 400, 900, { landing: 1, phase: "presentable" }).some((each) => each.step === "show")).toBe(
      true,
    );
  });

  test("begun while the view closes does not stop the blink", () => {
    const teleport = newTeleport();
    commit(teleport, 1, target);
    advance(teleport, 0, { landing: 1, phase: "presentable" });
    expect(beginAim(teleport, 0)).toBe(true);
    expect(run(teleport, 11, 600, { landing: 1, phase: "presentable" }).some((each) => each.step === "show")).toBe(
      true,
    );
    expect(phaseOf(teleport)).toBe("aiming");
  });
});

test("a session begins black and opens", () => {
  const teleport = newTeleport();
  beginBlack(teleport, 0);
  expect(teleport.opacity).toBe(1);
  advance(teleport, 40, { landing: 0, phase: "idle" });
  expect(teleport.opacity).toBe(1);
  advance(teleport, 40 + FADE_IN_MS, { landing: 0, phase: "idle" });
  expect(teleport.opacity).toBe(0);
  expect(phaseOf(teleport)).toBe("idle");
});
