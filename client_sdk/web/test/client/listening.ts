/** A direct stream whose events are kept and can be waited for. */

import { openDirectStream } from "../../src/core/client/direct-stream.ts";
import type { Stream, StreamEvent, StreamOptions } from "../../src/core/types.ts";

type Of<T extends StreamEvent["type"]> = Extract<StreamEvent, { type: T }>;

export interface Listening {
  readonly stream: Stream;
  readonly events: StreamEvent[];
  of<T extends StreamEvent["type"]>(type: T): Of<T>[];
  /** The first event of a kind, past or to come, that fits. */
  until<T extends StreamEvent["type"]>(type: T, fits?: (event: Of<T>) => boolean): Promise<Of<T>>;
  /** The end of one landing. */
  ready(landing: number): Promise<Of<"ready">>;
}

/** Open a stream in this thread and listen. */
export function listening(options: Partial<StreamOptions> & { sceneUrl: string }): Listening {
  const stream = openDirectStream(options as StreamOptions);
  const events: StreamEvent[] = [];
  const waiting = new Set<(event: StreamEvent) => void>();
  stream.onEvent = (event) => {
    events.push(event);
    for (const resolve of waiting) resolve(event);
  };
  const isOf = <T extends StreamEvent["type"]>(type: T, event: StreamEvent): event is Of<T> => event.type === type;
  const of = <T extends StreamEvent["type"]>(type: T) => events.filter((event): event is Of<T> => isOf(type, event));
  const until = <T extends StreamEvent["type"]>(type: T, fits: (event: Of<T>) => boolean = () => true) => {
    const past = of(type).find(fits);
    if (past !== undefined) return Promise.resolve(past);
    return new Promise<Of<T>>((resolve) => {
      const take = (event: StreamEvent) => {
        if (!isOf(type, event) || !fits(event)) return;
        waiting.delete(take);
        resolve(event);
      };
      waiting.add(take);
    });
  };
  return { stream, events, of, until, ready: (landing) => until("ready", (event) => event.landing === landing) };
}
