/** What the address of a session says. PURE. */

import { parseRoute, type Route } from "../app/route.ts";
import type { Condition } from "./log.ts";

/** See docs/how-to/study.md. */
export interface StudySettings {
  readonly scene: string;
  readonly condition: Condition;
  readonly participant: string;
  /** Which of the participant's sessions this is, from 1. */
  readonly order: number;
  /** Error that the baseline allows, pixels; null: that which refines as far as a landing reaches. */
  readonly maxErrorPx: number | null;
  /** Landings' radius, metres; null: the page's own. */
  readonly radiusM: number | null;
  /** Whether SSQ and VRSQ are asked. */
  readonly asks: boolean;
  /** Where to begin. */
  readonly route: Route;
}

const NAME = /^[A-Za-z0-9_-]{1,40}$/;

/**
 * Read the query and the hash: the hash is the viewer's, which writes it anew wherever the user goes. Throws what is wrong: a
 * session under a wrong condition would be worthless.
 */
export function parseSettings(query: string, hash: string): StudySettings {
  const fields = new URLSearchParams(query);
  const route = parseRoute(hash);
  if (route.scene === null) throw new Error("the address names no scene; expected ?condition=landings#scene=ID");
  const condition = fields.get("condition");
  if (condition !== "landings" && condition !== "head")
    throw new Error(`condition ${String(condition)}; expected landings (detail frozen between landings) or head`);
  const participant = fields.get("participant") ?? "0";
  if (!NAME.test(participant)) throw new Error(`participant ${participant}; expected letters, digits, - and _`);
  const order = Number(fields.get("order") ?? 1);
  if (!Number.isInteger(order) || order < 1) throw new Error(`order ${fields.get("order")}; expected 1, 2, ...`);
  return {
    scene: route.scene,
    condition,
    participant,
    order,
    maxErrorPx: positive(fields, "error"),
    radiusM: positive(fields, "radius"),
    asks: fields.get("forms") !== "no",
    route,
  };
}

function positive(fields: URLSearchParams, name: string): number | null {
  const text = fields.get(name);
  if (text === null) return null;
  const value = Number(text);
  if (!(value > 0 && Number.isFinite(value))) throw new Error(`${name} ${text}; expected a number above 0`);
  return value;
}
