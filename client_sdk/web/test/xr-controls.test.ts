import { describe, expect, test } from "vitest";
import { VIGNETTE_CLOSE_MS, VIGNETTE_OPEN_MS } from "../src/xr/curves.ts";
import { chooseFrameRate, profileOf } from "../src/xr/device.ts";
import { addTime, newFrameTimes, summarise } from "../src/xr/frames.ts";
import { HOLD_MS, holdPalm, newPalmHold, palmTowards } from "../src/xr/palm.ts";
import { askTurn, dueTurn, facingOfStick, newSnapTurn, newStick, readStick, vignetteOf } from "../src/xr/snap.ts";
import { BEFORE_MS, clearTrail, newTrail, noteTarget, targetBefore } from "../src/xr/steady.ts";

describe("thumbstick", () => {
  test("one push is one turn, until it comes back near the middle", () => {
    const stick = newStick();
    const pushes = [0.2, 0.6, 0.75, 1, 0.9, 0.5, 0.72, 0.3, 0.8].map((x) => readStick(stick, x, 0));
    expect(pushes).toEqual(["none", "none", "right", "none", "none", "none", "none", "none", "right"]);
  });

  test.each([
    [-1, 0.2, "left"],
    [0.9, -0.3, "right"],
    [0.1, -0.95, "forward"],
    [0.2, 0.9, "back"],
    [0.3, 0.3, "none"],
  ] as const)("(%d, %d) is %s", (x, y, push) => {
    expect(readStick(newStick(), x, y)).toBe(push);
  });

  test("chooses a facing in eighths, and letting it go changes nothing", () => {
    expect(facingOfStick(0, -1, 3)).toBe(0);
    expect(facingOfStick(-1, 0, 0)).toBeCloseTo(Math.PI / 2);
    expect(facingOfStick(0.9, 0.1, 0)).toBeCloseTo(-Math.PI / 2);
    expect(facingOfStick(0.7, -0.7, 0)).toBeCloseTo(-Math.PI / 4);
    expect(facingOfStick(0.5, 0.5, 1.25)).toBe(1.25);
    expect(facingOfStick(0, 0, -0.5)).toBe(-0.5);
  });
});

describe("snap turn", () => {
  test("happens in one frame, behind a closed vignette", () => {
    const turn = newSnapTurn();
    askTurn(turn, 0.5, 100);
    let turned = 0;
    let closedThen = 0;
    for (let timeMs = 100; timeMs < 500; timeMs += 11) {
      const due = dueTurn(turn, timeMs);
      if (due !== 0) {
        turned += 1;
        closedThen = vignetteOf(turn, timeMs);
        expect(due).toBe(0.5);
        expect(timeMs - 100).toBeGreaterThanOrEqual(VIGNETTE_CLOSE_MS);
      }
    }
    expect(turned).toBe(1);
    expect(closedThen).toBe(1);
    expect(vignetteOf(turn, 100 + VIGNETTE_CLOSE_MS + VIGNETTE_OPEN_MS + 30)).toBe(0);
    expect(turn.phase).toBe("none");
  });

  test("a second push while it closes adds up; while it opens it closes again without a jump", () => {
    const turn = newSnapTurn();
    askTurn(turn, 0.5, 0);
    askTurn(turn, 0.5, 20);
    expect(dueTurn(turn, 60)).toBe(1);
    const half = vignetteOf(turn, 60 + VIGNETTE_OPEN_MS / 2);
    expect(half).toBeCloseTo(0.5);
    askTurn(turn, -0.5, 60 + VIGNETTE_OPEN_MS / 2);
    expect(vignetteOf(turn, 60 + VIGNETTE_OPEN_MS / 2)).toBeCloseTo(half);
    expect(dueTurn(turn, 60 + VIGNETTE_OPEN_MS / 2 + VIGNETTE_CLOSE_MS)).toBe(-0.5);
  });
});

describe("pinch", () => {
  test("lands where the ring was before the hand began to open", () => {
    const trail = newTrail();
    for (let k = 0; k < 40; k++) {
      noteTarget(trail, k * 11, [k, 0, 0]);
    }
    const nowMs = 40 * 11;
    expect(targetBefore(trail, nowMs, 0)).toEqual([39, 0, 0]);
    const position = targetBefore(trail, nowMs, BEFORE_MS)!;
    expect(position[0] * 11).toBeLessThanOrEqual(nowMs - BEFORE_MS);
    expect(position[0] * 11).toBeGreaterThan(nowMs - BEFORE_MS - 12);
  });

  test("released at once, the first place counts; over no ground, none; before any frame, none", () => {
    const trail = newTrail();
    expect(targetBefore(trail, 0, BEFORE_MS)).toBeNull();
    noteTarget(trail, 10, [1, 1, 1]);
    noteTarget(trail, 21, [2, 2, 2]);
    expect(targetBefore(trail, 30, BEFORE_MS)).toEqual([1, 1, 1]);
    noteTarget(trail, 32, null);
    expect(targetBefore(trail, 40, 0)).toBeNull();
    clearTrail(trail);
    expect(targetBefore(trail, 40, 0)).toBeNull();
  });
});

describe("palm", () => {
  // Column-major: the hand 0.4 m before and below the eyes; its back (+Y) away from or towards them.
  const wrist = (backY: number): number[] => [1, 0, 0, 0, 0, backY, 0, 0, 0, 0, backY, 0, 0, 1.3, -0.1, 1];
  const eye = [0, 1.6, 0] as const;

  test("is told from the hand's back, and from a hand far from the eyes", () => {
    expect(palmTowards(wrist(-1), eye)).toBeGreaterThan(0.9);
    expect(palmTowards(wrist(1), eye)).toBeLessThan(-0.9);
    expect(palmTowards([1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0.7, 0, 1], eye)).toBe(-1);
  });

  test("opens the menu once for a hold, and again only after it was turned away", () => {
    const hold = newPalmHold();
    const opened: number[] = [];
    for (let timeMs = 0; timeMs < 3000; timeMs += 10) {
      const towards = timeMs > 1500 && timeMs < 1600 ? 0.1 : 0.95;
      if (holdPalm(hold, towards, timeMs)) {
        opened.push(timeMs);
      }
    }
    expect(opened).toEqual([HOLD_MS, 1600 + HOLD_MS]);
  });

  test("a glance is not enough", () => {
    const hold = newPalmHold();
    expect(holdPalm(hold, 0.95, 0)).toBe(false);
    expect(holdPalm(hold, 0.95, HOLD_MS - 1)).toBe(false);
    expect(holdPalm(hold, 0.3, HOLD_MS)).toBe(false);
    expect(holdPalm(hold, 0.95, HOLD_MS + 1)).toBe(false);
  });
});

describe("device", () => {
  const agent = (name: string): string =>
    `Mozilla/5.0 (X11; Linux x86_64; ${name}) AppleWebKit/537.36 (KHTML, like Gecko) OculusBrowser/33.0 Chrome/126.0 VR`;

  test.each([
    [agent("Quest 3"), 90],
    [agent("Quest 3S"), 90],
    [agent("Quest Pro"), 90],
    [agent("Quest 2"), 72],
    [agent("Quest"), 72],
    ["Mozilla/5.0 (Windows NT 10.0; Win64; x64) Chrome/140.0", 90],
  ])("%s: %d Hz", (userAgent, frameRateHz) => {
    expect(profileOf(userAgent).frameRateHz).toBe(frameRateHz);
  });

  test("takes the highest rate that is offered and not above what is wanted", () => {
    expect(chooseFrameRate(new Float32Array([72, 80, 90, 120]), 90)).toBe(90);
    expect(chooseFrameRate(new Float32Array([60, 72, 80]), 90)).toBe(80);
    expect(chooseFrameRate([89.99, 120], 90)).toBe(89.99);
    expect(chooseFrameRate([120, 144], 90)).toBe(120);
    expect(chooseFrameRate([], 90)).toBeNull();
    expect(chooseFrameRate(undefined, 72)).toBeNull();
  });
});

test("frame times are of the last 240 frames", () => {
  const times = newFrameTimes();
  expect(summarise(times)).toEqual({ medianMs: 0, p99Ms: 0, maxMs: 0 });
  for (let k = 0; k < 1000; k++) {
    addTime(times, k < 700 ? 500 : 10);
  }
  addTime(times, 30);
  expect(summarise(times)).toMatchObject({ medianMs: 10, maxMs: 30 });
});
