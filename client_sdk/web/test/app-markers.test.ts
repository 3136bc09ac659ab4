/** The markers' lines: what is visible when, without a screen. */

import type { Group } from "three";
import { expect, test } from "vitest";
import { createMarkers, type Markers } from "../src/app/viewer/markers.ts";

const level = () => 2;

function visibleLines({ object }: Markers): number {
  return object.children.filter((line) => (line as Group).visible).length;
}

/** Frames until nothing is left to lay. */
function layAll(markers: Markers, ground: (x: number, z: number) => number | null): void {
  for (let frame = 0; frame < 1000 && markers.step(ground); frame += 1);
}

test("an edge is shown once it is laid, and not at the place of the last one before", () => {
  const markers = createMarkers();
  expect(visibleLines(markers)).toBe(0);
  markers.setEdge([0, 0, 20], 40);
  layAll(markers, level);
  expect(visibleLines(markers)).toBe(2);
  markers.setEdge([50, 0, 20], 40);
  expect(visibleLines(markers)).toBe(0);
  layAll(markers, level);
  expect(visibleLines(markers)).toBe(2);
  markers.setEdge(null, 0);
  expect(visibleLines(markers)).toBe(0);
  markers.dispose();
});

test("an edge beyond the ground is none", () => {
  const markers = createMarkers();
  markers.setEdge([0, 0, 0], 500);
  layAll(markers, (x) => (x > 450 ? 0 : null));
  expect(visibleLines(markers)).toBe(0);
  markers.dispose();
});

test("a new aim under a moving finger does not keep the ring away, and an edge waits behind it", () => {
  const markers = createMarkers();
  markers.setEdge([0, 0, 0], 30);
  for (let move = 0; move < 5; move += 1)
    markers.setAim({ place: [move, 0, 0], radiusM: 30 }, [0, 1.7, 9], [0, 1.7, 9]);
  // Dot and arc at once.
  expect(visibleLines(markers)).toBe(2);
  layAll(markers, level);
  expect(visibleLines(markers)).toBe(7);
  markers.setAim(null, [0, 0, 0], [0, 0, 0]);
  expect(visibleLines(markers)).toBe(2);
  markers.dispose();
});

test("an aim that was taken back leaves no ring behind", () => {
  const markers = createMarkers();
  markers.setAim({ place: [1, 0, 0], radiusM: 30 }, [0, 1.7, 9], [0, 1.7, 9]);
  markers.setAim(null, [0, 0, 0], [0, 0, 0]);
  layAll(markers, level);
  expect(visibleLines(markers)).toBe(0);
  markers.dispose();
});
