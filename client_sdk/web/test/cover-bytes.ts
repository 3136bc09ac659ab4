/** Covers to test with: `base.cover` as the plainest writer makes it, every step with a number and for one face. */

import { xxh3 } from "../src/core/payload/hash.ts";

/** The bytes of a cover with these rows. Needs `prepareHash`. */
export function coverBytes(rows: readonly (readonly number[])[]): Uint8Array<ArrayBuffer> {
  const steps: number[] = [];
  let last = 0;
  let before: readonly number[] = [];
  for (const row of rows) {
    const toggled = [...before.filter((id) => !row.includes(id)), ...row.filter((id) => !before.includes(id))];
    // The same row again: a segment goes in and out, or out and in.
    if (toggled.length === 0) toggled.push(0, 0);
    for (const [place, segment] of toggled.entries()) {
      steps.push(15 | (place + 1 === toggled.length ? 16 : 0), ...number(segment - last));
      last = segment;
    }
    before = row;
  }
  const bytes = new Uint8Array(32 + steps.length);
  const view = new DataView(bytes.buffer);
  bytes.set(Buffer.from("TPCOVER1"));
  view.setUint16(16, 1, true);
  view.setUint32(20, 32, true);
  view.setUint32(24, rows.length, true);
  view.setUint32(28, rows.flat().length, true);
  bytes.set(steps, 32);
  return sealed(bytes);
}

/** With the checksum that its bytes ask for. */
export function sealed(bytes: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  if (bytes.length >= 16) new DataView(bytes.buffer).setBigUint64(8, xxh3(bytes.subarray(16)), true);
  return bytes;
}

function number(ahead: number): number[] {
  let value = ahead < 0 ? -2 * ahead - 1 : 2 * ahead;
  const bytes: number[] = [];
  for (; value >= 128; value = Math.floor(value / 128)) bytes.push((value % 128) | 128);
  return [...bytes, value];
}
