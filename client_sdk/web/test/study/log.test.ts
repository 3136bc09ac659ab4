import { describe, expect, it } from "vitest";

import { SYMPTOMS, VRSQ_ROWS } from "../../src/study/forms.ts";
import { SessionLog } from "../../src/study/log.ts";
import { parseSettings } from "../../src/study/settings.ts";
import { parseWalk, poseAt } from "../../src/study/walk.ts";
import { cell, looking } from "./cells.ts";

const CELLS = new Map([cell(1, 0, -5), cell(3, 0, 3)].map((facts) => [facts.segment, facts]));
const HEAD = { position: [0, 0, 0] as const, yawDeg: 0, pitchDeg: 0, rollDeg: 0 };

function logged(frames: readonly (readonly [landing: number, isShown: boolean, visible: readonly number[]])[]) {
  const log = new SessionLog({
    condition: "head",
    scene: "pit",
    sceneVersion: "v-1",
    viewer: "0",
    participant: "7",
    order: 1,
    radiusM: 10,
    maxErrorPx: 10,
    walk: "live",
    started: "2026-11-24T00:00:00Z",
    device: "test",
  });
  for (const [index, [landing, isShown, visible]] of frames.entries()) {
    const now = { landing, isShown, position: [0, 0, 0] as const, radiusM: 10 };
    log.frame(index * 10, 10, HEAD, looking(true), visible, now, (segment) => CELLS.get(segment));
  }
  return log;
}

describe("the log", () => {
  it("tells a landing's own change from those after it", () => {
    const log = logged([
      [0, false, []],
      [1, false, []],
      [1, true, [1, 3]],
      [1, true, [1, 3]],
      [1, true, [1]],
      [1, true, []],
    ]);
    const { changes, landings } = log.toJson() as { changes: Record<string, unknown>[]; landings: object[] };
    expect(landings).toEqual([{ landing: 1, asked_ms: 10, arrived_ms: 20, position: [0, 0, 0], radius_m: 10 }]);
    expect(changes.map((change) => change.by_landing)).toEqual([true, false, false]);
    // 3 lies behind the head: nobody sees it go.
    expect(changes.map((change) => change.hidden_in_view)).toEqual([0, 0, 1]);
    expect(log.changesInView).toBe(1);
  });

  it("has none where nothing changes", () => {
    const still = Array.from({ length: 50 }, () => [1, true, [1, 3]] as const);
    expect(logged(still).changesInView).toBe(0);
  });

  it("counts what nothing is known of", () => {
    const log = logged([
      [1, true, []],
      [1, true, [99]],
    ]);
    expect(log.changesInView).toBe(1);
  });
});

describe("a walk", () => {
  const leg = { position: [1, 2, 3], radius_m: 20, poses: [] as number[][] };
  const walk = (poses: number[][]) => ({ form: 1, legs: [{ ...leg, poses }] });

  it("is gone along between its poses, turning the short way", () => {
    const [parsed] = parseWalk(
      walk([
        [0, 0, 1, 0, 350, 0],
        [2, 4, 1, 0, 10, -10],
      ]),
    );
    expect(poseAt(parsed!, 1)).toEqual({ eye: [2, 1, 0], yawDeg: 360, pitchDeg: -5 });
    expect(poseAt(parsed!, 2.01)).toBeNull();
  });

  it.each([
    [null, "no object"],
    [{ form: 2, legs: [] }, "form 2"],
    [{ form: 1, legs: [] }, "without a leg"],
    [walk([]), "no pose"],
    [walk([[0, 0, 0]]), "6 numbers"],
    [{ form: 1, legs: [{ ...leg, radius_m: 0, poses: [[0, 0, 0, 0, 0, 0]] }] }, "radius 0"],
  ])("that is none is refused: %j", (document, words) => {
    expect(() => parseWalk(document)).toThrow(words);
  });
});

describe("a session's address", () => {
  it("says all there is", () => {
    const settings = parseSettings("?condition=head&participant=p-7&order=2&error=16&radius=40&forms=no", "#scene=pit");
    expect(settings).toMatchObject({
      scene: "pit",
      condition: "head",
      participant: "p-7",
      order: 2,
      maxErrorPx: 16,
      radiusM: 40,
      asks: false,
    });
  });

  it.each([
    ["?condition=head", ""],
    ["", "#scene=pit"],
    ["?condition=both", "#scene=pit"],
    ["?condition=head&error=-1", "#scene=pit"],
    ["?condition=head&participant=A%20Name", "#scene=pit"],
  ])("that is incomplete is refused: %s %s", (query, hash) => {
    expect(() => parseSettings(query, hash)).toThrow();
  });
});

it("asks the VRSQ's nine symptoms among the SSQ's sixteen", () => {
  expect(SYMPTOMS.length).toBe(16);
  expect(VRSQ_ROWS.map((row) => SYMPTOMS[row])).toEqual([
    "General discomfort",
    "Fatigue",
    "Eye strain",
    "Difficulty focusing",
    "Headache",
    "Fullness of head",
    "Blurred vision",
    "Dizziness with eyes closed",
    "Vertigo",
  ]);
});
