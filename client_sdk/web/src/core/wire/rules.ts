/** Rules between the fields of one message, which no table can say (wire protocol, sections 6 and 13). */

import type {
  AimMessage,
  GatherMessage,
  LandMessage,
  MessageWithRule,
  PlanMessage,
  PrefetchMessage,
} from "./messages.generated.ts";
import { Refused } from "./refused.ts";

/**
 * Check the rules of a message whose fields are right.
 *
 * @throws Refused With the field that contradicts another.
 */
export function checkRules(type: string, values: object): void {
  if (Object.hasOwn(RULES, type)) RULES[type as MessageWithRule](values as never);
}

const RULES: Readonly<Record<MessageWithRule, (values: never) => void>> = {
  aim(aim: AimMessage) {
    checkCoarseRadius(aim);
  },

  land(land: LandMessage) {
    checkCoarseRadius(land);
    for (const name of ["deadline_ms", "stall_ms"] as const) {
      if (land.inner_radius_m === undefined && land[name] !== undefined) {
        throw new Refused("got a deadline without inner_radius_m, expected both", name);
      }
    }
    checkInnerRadius(land);
  },

  gather(gather: GatherMessage) {
    checkInnerRadius(gather);
  },

  plan(plan: PlanMessage) {
    expectSum("load_bytes", plan.load_bytes, sum(plan.load, "length"));
    expectSum("load_triangles", plan.load_triangles, sum(plan.load, "faces"));
    for (const [total, addend] of [
      ["total_bytes", "load_bytes"],
      ["total_triangles", "load_triangles"],
    ] as const) {
      if (plan[total] < plan[addend]) throw new Refused(`got ${plan[total]}, expected at least ${addend}`, total);
    }
    if ((plan.omitted_by === undefined) !== (plan.omitted_segments === 0)) {
      throw new Refused("got one of omitted_by and omitted_segments, expected both", "omitted_by");
    }
    checkOverlap(plan);
  },

  prefetch(prefetch: PrefetchMessage) {
    expectSum("bytes", prefetch.bytes, sum(prefetch.segments, "length"));
  },
};

function checkCoarseRadius({ coarse_radius_m, radius_m }: AimMessage | LandMessage): void {
  if (coarse_radius_m === undefined || coarse_radius_m >= radius_m) return;
  throw new Refused(`got ${coarse_radius_m}, expected at least radius_m ${radius_m}`, "coarse_radius_m");
}

function checkInnerRadius({ inner_radius_m, radius_m }: LandMessage | GatherMessage): void {
  if (inner_radius_m === undefined || inner_radius_m <= radius_m) return;
  throw new Refused(`got ${inner_radius_m}, expected at most radius_m ${radius_m}`, "inner_radius_m");
}

function checkOverlap({ load, keep, nearby }: PlanMessage): void {
  const loaded = new Set(load.map((row) => row.segment));
  const keepIds = new Set(keep);
  const text = (other: string) => `got an id of ${other}, expected load, keep and nearby to be disjoint`;
  if (load.some((row) => keepIds.has(row.segment))) throw new Refused(text("keep"), "load");
  if (nearby.some((segment) => keepIds.has(segment))) throw new Refused(text("keep"), "nearby");
  if (nearby.some((segment) => loaded.has(segment))) throw new Refused(text("load"), "nearby");
}

function sum(rows: PlanMessage["load"], name: "length" | "faces"): number {
  return rows.reduce((total, row) => total + row[name], 0);
}

function expectSum(field: string, actual: number, expected: number): void {
  if (actual !== expected) throw new Refused(`got ${actual}, expected the sum over the segments, ${expected}`, field);
}
