/** Plain values as JSON text, as the Python side writes them: a float has a point or an exponent, an integer neither. */

import type { Plain } from "./plain.ts";
import { WholeFloat } from "./plain.ts";

/** Write one value. It holds no binary: the tables give lists for JSON. */
export function writeJson(value: Plain): string {
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : floatText(value);
  if (value instanceof WholeFloat) return floatText(value.value);
  if (typeof value === "bigint") return String(value);
  if (value instanceof Uint8Array) throw new TypeError("binary has no JSON form");
  if (Array.isArray(value)) return `[${value.map(writeJson).join(",")}]`;
  if (value instanceof Map) {
    const members = [...value].map(([key, item]) => `${JSON.stringify(key)}:${writeJson(item)}`);
    return `{${members.join(",")}}`;
  }
  return JSON.stringify(value);
}

/** The shortest digits that give the number back, laid out as Python does: an exponent below 1e-4 and from 1e16. */
function floatText(value: number): string {
  const sign = value < 0 || Object.is(value, -0) ? "-" : "";
  const [mantissa = "", tail = "0"] = Math.abs(value).toExponential().split("e");
  const exponent = Number(tail);
  if (exponent < -4 || exponent >= 16) {
    const size = String(Math.abs(exponent)).padStart(2, "0");
    return `${sign}${mantissa}e${exponent < 0 ? "-" : "+"}${size}`;
  }
  const digits = mantissa.replace(".", "");
  if (exponent < 0) return `${sign}0.${"0".repeat(-exponent - 1)}${digits}`;
  const point = exponent + 1;
  const whole = digits.slice(0, point).padEnd(point, "0");
  return `${sign}${whole}.${digits.slice(point) || "0"}`;
}
