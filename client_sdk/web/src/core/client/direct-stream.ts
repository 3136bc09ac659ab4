/** A stream in the calling thread, for Node and for tests: the same session and connection, without workers. */

import { decodeSegment } from "../payload/segment-format.ts";
import { StreamError } from "../scene/errors.ts";
import type { Stream, StreamEvent, StreamOptions } from "../types.ts";
import { imageDecoder } from "./image-decoder.ts";
import { StreamCore } from "./stream-core.ts";

/** What {@link openDirectStream} may be given in place of what the platform has. */
export interface DirectParts {
  /** For platforms without a global WebSocket. */
  readonly WebSocket?: typeof WebSocket;
}

/**
 * Open a stream in this thread. Returns at once; set `onEvent` in the same task.
 *
 * Where the platform has no `createImageBitmap`, meshes come without their image.
 *
 * @throws StreamError `invalid_url`, or without a WebSocket; RangeError on options that the protocol does not allow.
 */
export function openDirectStream(options: StreamOptions, platform: DirectParts = {}): Stream {
  const Socket = platform.WebSocket ?? globalThis.WebSocket;
  if (Socket === undefined) throw new StreamError("internal", "this platform has no WebSocket; pass one");
  const emit = (event: StreamEvent) => {
    try {
      stream.onEvent(event);
    } catch (error) {
      queueMicrotask(() => {
        throw error; // The listener's own: as if it were called by the platform.
      });
    }
  };
  const core = new StreamCore(options, {
    WebSocket: Socket,
    decode: (payload, attributes) => decodeSegment(payload, attributes, imageDecoder()),
    emit,
  });
  const stream: Stream = {
    onEvent: () => {},
    land: (position, radiusM, landOptions) => core.land(position, radiusM, landOptions),
    aim: (position, radiusM, coarseRadiusM) => core.aim(position, radiusM, coarseRadiusM),
    pick: (origin, direction) => core.pick(origin, direction),
    mesh: (key, attributes) => core.mesh(key, attributes),
    stats: async () => core.stats(),
    group: (command) => core.group(command),
    reconnect: (token) => core.reconnect(token),
    close: () => core.close(),
  };
  void core.start();
  return stream;
}
