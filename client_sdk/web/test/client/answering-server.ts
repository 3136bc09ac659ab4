/**
 * The other end of a link: a server that answers what it is asked, one landing at a time. How a session behaves is shown by
 * the landings corpus, which the real server made; tests of the link need a server that answers when they choose.
 */

import { gzipSync } from "node:zlib";
import type { Vec3 } from "../../src/core/types.ts";
import { type Plain, readMsgpack, WholeFloat, writeMsgpack } from "../../src/core/wire/msgpack.ts";
import { TOY, type ToySegment, toyWithin } from "./toy-scene.ts";

type Data = Uint8Array<ArrayBuffer>;
type Fields = Readonly<Record<string, unknown>>;

const HIDDEN = new Uint8Array(gzipSync(new Uint8Array(1)));

/** One connection. */
export class AnsweringServer {
  /** Of the scene. */
  version = "v1";
  /** Everything that the client sent, in order. */
  readonly received: (Fields & { readonly type: string })[] = [];
  readonly #out: Data[] = [];

  send(message: Fields): void {
    this.#out.push(encoded(message));
  }

  receive(data: Data): void {
    const message = fromPlain(readMsgpack(data)) as Fields & { readonly type: string };
    this.received.push(message);
    if (message.type === "hello") this.#welcome();
    else if (message.type === "land") this.#plan(message);
  }

  /** The next WebSocket message; null where nothing is to be sent. */
  next(): Data | null {
    return this.#out.shift() ?? null;
  }

  #welcome(): void {
    this.send({
      type: "welcome",
      server: "answering",
      session: "s",
      scene: { id: "toy", version: this.version, name: "toy", segment_count: TOY.length, base_faces: 8, levels: 1 },
      limits: {
        max_radius_m: 500,
        max_message_bytes: 1 << 20,
        max_messages_per_s: 60,
        max_credit_bytes: 1 << 26,
        idle_timeout_s: 60,
        groups: "none",
      },
    });
  }

  #plan({ generation, position, radius_m: radiusM, have }: Fields): void {
    const held = have as Uint8Array;
    const isHeld = ({ key }: ToySegment) =>
      Array.from({ length: held.length / 8 }, (_, at) => Buffer.from(held).readBigUInt64LE(8 * at)).includes(
        BigInt(`0x${key}`),
      );
    const show = toyWithin(position as Vec3, radiusM as number);
    this.send({ generation, ...planOf(show, radiusM as number, (segment) => !isHeld(segment)) });
    for (const { key, payload } of show.filter((segment) => !isHeld(segment))) {
      const frame = new Uint8Array(24 + payload.length);
      const view = new DataView(frame.buffer);
      view.setUint8(0, 1);
      view.setUint16(2, 24, true);
      view.setUint32(4, generation as number, true);
      view.setBigUint64(8, BigInt(`0x${key}`), true);
      view.setUint32(20, payload.length, true);
      frame.set(payload, 24);
      this.#out.push(frame);
    }
    this.send({ type: "ready", generation });
  }
}

/** A plan, but for its generation. */
export function planOf(
  show: readonly ToySegment[],
  radiusM: number,
  follows: (segment: ToySegment) => boolean,
): Fields {
  const rows = new DataView(new ArrayBuffer(28 * show.length));
  show.forEach((segment, row) => {
    rows.setBigUint64(28 * row, BigInt(`0x${segment.key}`), true);
    const { length } = segment.payload;
    for (const [place, value] of [row, length, 1, 3, Number(follows(segment))].entries()) {
      rows.setUint32(28 * row + 8 + 4 * place, value, true);
    }
  });
  const table = new Uint8Array(rows.buffer);
  return { type: "plan", show: table, hidden: HIDDEN, effective_radius_m: radiusM, omitted: 0 };
}

/** A message as it is sent. */
export function encoded(message: Fields): Data {
  return writeMsgpack(toPlain(message));
}

function toPlain(value: unknown): Plain {
  if (typeof value !== "object" || value === null || value instanceof Uint8Array) return value as Plain;
  if (Array.isArray(value)) return value.map(toPlain);
  return new Map(Object.entries(value).map(([key, one]) => [key, toPlain(one)]));
}

function fromPlain(value: Plain): unknown {
  if (value instanceof Map) return Object.fromEntries([...value].map(([key, one]) => [key, fromPlain(one)]));
  if (Array.isArray(value)) return value.map(fromPlain);
  return value instanceof WholeFloat ? value.value : value;
}
