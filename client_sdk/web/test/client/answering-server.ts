/**
 * The other end of a link: a server that answers what it is asked, one landing at a time, and no more. How a session
 * behaves is shown by the session corpus, which the real server's state machine made; tests of the link need somebody
 * who answers at a time that they choose.
 */

import { decodeMessage, encodeMessage } from "../../src/core/wire/codec.ts";
import { encodeFrame } from "../../src/core/wire/frames.ts";
import type { ClientMessage, LandMessage, ServerMessage } from "../../src/core/wire/messages.generated.ts";
import { PROTOCOL } from "../../src/core/wire/messages.generated.ts";
import type { ToyScene } from "./toy-scene.ts";

type Data = Uint8Array<ArrayBuffer>;

/** One connection. */
export class AnsweringServer {
  /** Everything that the client said, in order. */
  readonly heard: ClientMessage[] = [];
  readonly #scene: ToyScene;
  readonly #held = new Set<number>();
  readonly #out: ServerMessage[] = [];
  /** The landing that is being sent. */
  #landing: { generation: number; queue: number[]; bytes: number } | null = null;

  constructor(scene: ToyScene) {
    this.#scene = scene;
  }

  say(message: ServerMessage): void {
    this.#out.push(message);
  }

  receive(data: Data): void {
    const message = decodeMessage(data, "client_to_server");
    if (message.type === "unknown") throw new Error(`the client said ${message.name}`);
    this.heard.push(message);
    if (message.type === "hello") this.#welcome(message);
    else if (message.type === "land") this.#plan(message);
    else if (message.type === "evict") for (const segment of message.segments) this.#held.delete(segment);
  }

  /** The next WebSocket message; null where nothing is to be said. */
  next(): Data | null {
    const message = this.#out.shift();
    if (message !== undefined) return encodeMessage(message);
    const landing = this.#landing;
    if (landing === null) return null;
    const { generation, bytes } = landing;
    const segment = landing.queue.shift();
    if (segment === undefined) {
      this.#landing = null;
      return encodeMessage({ type: "ready", generation, delivered: 0, payload_bytes: bytes, missing: [] });
    }
    const chunk = this.#scene.payloads[segment]!;
    landing.bytes += chunk.length;
    this.#held.add(segment);
    return encodeFrame({ generation, segment, offset: 0, total: chunk.length, chunk });
  }

  #welcome(hello: ClientMessage & { type: "hello" }): void {
    for (const { segment } of hello.held ?? []) this.#held.add(segment);
    this.say({
      type: "welcome",
      protocol: PROTOCOL,
      server: "answering",
      session: "s",
      scene: { id: "toy", version: this.#scene.version, name: "toy", segment_count: this.#scene.facts.length },
      limits: {
        max_radius_m: 500,
        max_message_bytes: 1 << 20,
        max_messages_per_s: 60,
        max_held_segments: 1000,
        max_plan_segments: 16384,
        max_credit_bytes: 1 << 26,
        idle_timeout_s: 60,
      },
      release_factor: 1,
      dropped: [],
      held_count: this.#held.size,
    });
  }

  #plan({ generation, position, radius_m }: LandMessage): void {
    const superseded = this.#landing?.generation;
    if (superseded !== undefined)
      this.say({ type: "superseded", generation: superseded, by: generation, unsent_bytes: 0 });
    const wanted = this.#scene.within(position, radius_m);
    const load = wanted.filter((segment) => !this.#held.has(segment));
    this.#landing = { generation, queue: load, bytes: 0 };
    this.say({
      type: "plan",
      generation,
      position,
      radius_m,
      release_radius_m: radius_m,
      effective_radius_m: radius_m,
      inner_count: 0,
      load: load.map((segment) => this.#scene.facts[segment]!),
      keep: wanted.filter((segment) => this.#held.has(segment)),
      nearby: [],
      load_bytes: this.#scene.bytesOf(load),
      load_triangles: 10 * load.length,
      total_bytes: this.#scene.bytesOf(wanted),
      total_triangles: 10 * wanted.length,
      omitted_segments: 0,
    });
  }
}
