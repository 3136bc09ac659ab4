/** An in-memory pair: the client's state machine and the model server, without a socket. */

import type { SessionEvent } from "../../src/core/session/events.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import type { Budgets } from "../../src/core/types.ts";
import { type ModelOptions, ModelServer } from "./model-server.ts";
import { type ToyScene, toyHash } from "./toy-scene.ts";

type Data = Uint8Array<ArrayBuffer>;

export interface PairOptions extends ModelOptions {
  readonly cacheBytes?: number;
  readonly creditBytes?: number;
  readonly releaseFactor?: number;
  readonly budgets?: Budgets;
  /** Messages of the server that are on their way before one arrives. */
  readonly lag?: number;
}

/** One client, over as many connections to one server as it takes. */
export class Pair {
  scene: ToyScene;
  readonly client: ClientSession;
  server: ModelServer | null = null;
  events: SessionEvent[] = [];
  /** Ids of segments that came whole, in order. */
  received: number[] = [];
  /** Changes the bytes of a frame on its way. */
  spoil: ((data: Uint8Array<ArrayBuffer>) => Uint8Array<ArrayBuffer>) | null = null;
  offerHeld = true;
  readonly #options: PairOptions;
  #down: Data[] = [];

  constructor(scene: ToyScene, options: PairOptions = {}) {
    this.scene = scene;
    this.#options = options;
    this.client = new ClientSession(
      {
        client: "pair",
        budgets: options.budgets ?? {},
        creditBytes: options.creditBytes ?? 4096,
        releaseFactor: options.releaseFactor ?? 1,
      },
      options.cacheBytes ?? 1 << 20,
      toyHash,
    );
  }

  /** Begin a connection; nothing flows before {@link step}. */
  connect(): this {
    this.server = new ModelServer(this.scene, this.#options);
    this.client.connected(this.offerHeld);
    return this;
  }

  /** Lose the connection with everything that was on its way. */
  disconnect(): void {
    this.server = null;
    this.#down = [];
    this.client.connectionLost();
    this.#collect();
  }

  /** Let one thing happen; whether anything did. */
  step(): boolean {
    this.#collect();
    const server = this.server;
    if (server === null) return false;
    const sent = this.client.dataToSend();
    for (const data of sent) server.receive(data);
    const data = server.next();
    if (data !== null) this.#down.push(this.#carried(data));
    const lag = data !== null || sent.length > 0 ? (this.#options.lag ?? 0) : 0;
    const arrives = this.#down.length > lag ? this.#down.shift() : undefined;
    if (arrives === undefined) return data !== null || sent.length > 0;
    this.client.receive(arrives);
    this.#collect();
    return true;
  }

  /** Let everything happen that will; `flush` sends aims as the link would. */
  settle(flush = false): void {
    while (this.step()) if (flush) this.client.flushAim();
  }

  of<T extends SessionEvent["type"]>(type: T): Extract<SessionEvent, { type: T }>[] {
    return this.events.filter((event): event is Extract<SessionEvent, { type: T }> => event.type === type);
  }

  #carried(data: Data): Data {
    const isFrame = data[0]! < 0x80;
    return isFrame && this.spoil !== null ? this.spoil(data) : data;
  }

  #collect(): void {
    for (const event of this.client.events()) {
      this.events.push(event);
      if (event.type === "arrived") this.received.push(event.entry.facts.segment);
    }
  }
}

/** Flip a bit of the last byte of a frame. */
export function flipped(data: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  const spoilt = data.slice();
  spoilt[spoilt.length - 1]! ^= 1;
  return spoilt;
}

/** Segment id of a frame. */
export function segmentOf(frame: Uint8Array<ArrayBuffer>): number {
  return new DataView(frame.buffer).getUint32(8, true);
}
