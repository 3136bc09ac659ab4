import { expect, it } from "vitest";

import { FrameTimes } from "../../src/three/frame-times.ts";

it("tells the longest and the median of the last 240 frames", () => {
  const times = new FrameTimes();
  expect([times.maxMs, times.medianMs]).toEqual([0, 0]);
  times.add(900);
  for (let frame = 1; frame <= 239; frame += 1) {
    times.add(frame);
  }
  expect([times.maxMs, times.medianMs]).toEqual([900, 121]);
  times.add(1);
  expect([times.maxMs, times.medianMs]).toEqual([239, 120]);
});
