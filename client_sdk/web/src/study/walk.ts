/** A recorded walk: landings, and where the head goes after each (spec/study-log.md). PURE. */

import type { FreePose } from "../app/viewer/camera-desk.ts";
import type { Vec3 } from "../core/types.ts";

/** One landing and what follows it. */
export interface Leg {
  readonly position: Vec3;
  readonly radiusM: number;
  /** Seconds after the landing is shown, ascending; at least one. */
  readonly tS: readonly number[];
  readonly poses: readonly FreePose[];
}

/** Legs of a walk; a longer one is refused. */
const MAX_LEGS = 1000;
const MAX_POSES = 400_000;

/** Read a walk. Throws what is wrong with it. */
export function parseWalk(document: unknown): readonly Leg[] {
  const walk = record(document, "the walk");
  if (walk.form !== 1) throw new Error(`a walk of form ${String(walk.form)}, expected 1`);
  const legs = list(walk.legs, "legs", MAX_LEGS).map((value, index) => parseLeg(value, `leg ${index + 1}`));
  if (legs.length === 0) throw new Error("a walk without a leg");
  return legs;
}

function parseLeg(value: unknown, name: string): Leg {
  const leg = record(value, name);
  const rows = list(leg.poses, `poses of ${name}`, MAX_POSES).map((row) => numbers(row, 6, `a pose of ${name}`));
  if (rows.length === 0) throw new Error(`${name} has no pose`);
  const [x, y, z] = numbers(leg.position, 3, `position of ${name}`) as [number, number, number];
  const radiusM = Number(leg.radius_m);
  if (!(radiusM > 0)) throw new Error(`${name} has radius ${String(leg.radius_m)}, expected metres above 0`);
  return {
    position: [x, y, z],
    radiusM,
    tS: rows.map((row) => row[0]!),
    poses: rows.map((row) => ({ eye: [row[1]!, row[2]!, row[3]!], yawDeg: row[4]!, pitchDeg: row[5]! })),
  };
}

/** The pose at a time of a leg; null behind its end. */
export function poseAt({ tS, poses }: Leg, t: number): FreePose | null {
  if (t > tS.at(-1)!) return null;
  const after = tS.findIndex((time) => time >= t);
  if (after <= 0) return poses[0]!;
  const [a, b] = [poses[after - 1]!, poses[after]!];
  const span = tS[after]! - tS[after - 1]!;
  const share = span > 0 ? (t - tS[after - 1]!) / span : 1;
  const between = (from: number, to: number): number => from + (to - from) * share;
  return {
    eye: [between(a.eye[0], b.eye[0]), between(a.eye[1], b.eye[1]), between(a.eye[2], b.eye[2])],
    // The short way round.
    yawDeg: a.yawDeg + (((b.yawDeg - a.yawDeg + 540) % 360) - 180) * share,
    pitchDeg: between(a.pitchDeg, b.pitchDeg),
  };
}

function record(value: unknown, name: string): Record<string, unknown> {
  if (typeof value !== "object" || value === null || Array.isArray(value)) throw new Error(`${name} is no object`);
  return value as Record<string, unknown>;
}

function list(value: unknown, name: string, most: number): readonly unknown[] {
  if (!Array.isArray(value) || value.length > most) throw new Error(`${name}: expected a list of at most ${most}`);
  return value;
}

function numbers(value: unknown, count: number, name: string): readonly number[] {
  const row = list(value, name, count);
  if (row.length !== count || !row.every((one) => typeof one === "number" && Number.isFinite(one)))
    throw new Error(`${name}: expected ${count} numbers`);
  return row as readonly number[];
}
