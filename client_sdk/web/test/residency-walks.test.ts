import { beforeEach, describe, expect, it } from "vitest";

import { Residency } from "../src/core/residency.ts";
import type { PlanFacts } from "../src/core/types.ts";
import { random } from "./random.ts";
import { BYTES, facts, plan } from "./residency-plans.ts";

let residency: Residency;

beforeEach(() => {
  residency = new Residency({ maxInFlight: 4, maxInFlightBytes: 1e9, spareBytes: 3 * BYTES });
});

describe("whatever happens", () => {
  it.each(Array.from({ length: 40 }, (_, seed) => seed))("the visible set changes in swap alone (seed %i)", (seed) => {
    const next = random(seed);
    const pick = (count: number): number => Math.floor(next() * count);
    const ids = (): number[] => Array.from({ length: 24 }, (_, id) => id).filter(() => next() < 0.3);
    const gpu = new Set<number>(); // What a stage would hold.
    const decoding: { segment: number; epoch: number }[] = [];
    const heldIds = new Set<number>();
    let uploading: number[] = [];
    let landing = 0;
    let requestedPlan: PlanFacts | null = null;
    let swaps = 0;
    for (let step = 0; step < 1000; step += 1) {
      const visibleBefore = residency.visible;
      const act = pick(14);
      if (act === 0 && (landing === 0 || next() < 0.2)) {
        landing += 1;
        requestedPlan = null;
        residency.land(landing, [0, 0, 0], 60, step);
      } else if (act === 1 && landing > 0 && (requestedPlan === null || next() < 0.1)) {
        const target = ids();
        requestedPlan = plan(
          landing,
          target.filter((id) => !heldIds.has(id)),
          target.filter((id) => heldIds.has(id)),
          ids().filter((id) => heldIds.has(id) && !target.includes(id)),
        );
        residency.planned(requestedPlan);
      } else if (act === 2 && requestedPlan) {
        for (const { segment } of requestedPlan.load) {
          heldIds.add(segment);
          residency.arrived(facts(segment), landing);
        }
        const planned = [...requestedPlan.load.map(({ segment }) => segment), ...requestedPlan.keep].sort(
          (a, b) => a - b,
        );
        residency.ready(landing, planned, [], 1, 1);
      } else if (act === 3 && requestedPlan && requestedPlan.load[0]) {
        heldIds.add(requestedPlan.load[0].segment);
        residency.arrived(requestedPlan.load[0], landing);
        residency.degraded(landing, [requestedPlan.load[0].segment]);
      } else if (act === 4) {
        const segment = pick(24);
        heldIds.add(segment);
        residency.arrived(facts(segment), null);
      } else if (act === 5 && landing > 0 && next() < 0.2) {
        residency.refused(landing, "no");
      } else if (act === 6 && next() < 0.1) {
        residency.contextLost();
        gpu.clear();
        uploading = [];
      } else if (act === 7) {
        const dropped = ids().filter((id) => !residency.visible.includes(id) && next() < 0.1);
        residency.dropped(dropped);
      } else if (act === 8) {
        for (const segment of residency.takeFreed()) {
          gpu.delete(segment);
          uploading = uploading.filter((id) => id !== segment);
        }
      } else if (act < 12) {
        decoding.push(...residency.takeDecodes());
        expect(residency.inFlight).toBeLessThanOrEqual(4);
        const answer = decoding.splice(pick(Math.max(decoding.length, 1)), 1)[0];
        if (answer && next() < 0.03) {
          residency.decodeFailed(answer.segment, answer.epoch);
        } else if (answer) {
          residency.decoded(answer.segment, answer.epoch, BYTES);
        }
        const upload = residency.nextUpload();
        if (upload !== null) {
          residency.uploaded(upload);
          uploading.push(upload);
        }
        for (const segment of uploading.splice(0, 1)) {
          for (const freed of residency.takeFreed()) {
            gpu.delete(freed);
          }
          residency.warmed(segment);
          gpu.add(segment);
        }
      } else {
        residency.basePrepared(residency.comingRevision);
        const restorable = residency.restorable();
        if (restorable) {
          expect(restorable.every((segment) => gpu.has(segment))).toBe(true);
          residency.restored();
          expect(residency.visible).toEqual(restorable);
          continue;
        }
        const kind = residency.presentable();
        const swap = residency.swap();
        expect(swap !== null).toBe(kind !== null);
        if (swap) {
          swaps += 1;
          expect(swap.landing).toBe(landing);
          expect(residency.visible).toEqual(swap.visible);
          expect(swap.visible.every((segment) => gpu.has(segment))).toBe(true);
          expect(swap.shown).toEqual(swap.visible.filter((id) => !visibleBefore.includes(id)));
          expect(swap.hidden).toEqual(visibleBefore.filter((id) => !swap.visible.includes(id)));
          continue;
        }
      }
      expect(residency.visible).toBe(visibleBefore);
      expect(residency.spareBytes).toBeLessThanOrEqual(3 * BYTES);
    }
    expect(swaps).toBeGreaterThan(0);
  });
});
