/**
 * What a session tells the server in `hello`.
 *
 * PURE.
 */

import type { Budgets } from "../types.ts";
import type { HeldRow } from "../wire/kinds.ts";
import type { HelloMessage } from "../wire/messages.generated.ts";
import { PROTOCOL } from "../wire/messages.generated.ts";

export interface SessionOptions {
  /** Name and version of the client, for the server's logs. */
  readonly client: string;
  readonly budgets: Budgets;
  /**
   * Payload bytes under way at most. Half of it is granted back at a time: a larger one saves messages, a smaller one
   * bounds what lies in buffers when a landing is superseded.
   */
  readonly creditBytes: number;
  /** Release radius / load radius; undefined takes the server's. */
  readonly releaseFactor?: number | undefined;
}

/** The message that opens a connection. */
export function helloMessage(options: SessionOptions, heldRows: readonly HeldRow[]): HelloMessage {
  const { budgets } = options;
  return {
    type: "hello",
    protocol: PROTOCOL,
    client: options.client,
    encoding: "segment-2",
    budgets: {
      max_triangles: budgets.maxTriangles,
      max_bytes: budgets.maxBytes,
      max_segments: budgets.maxSegments,
      max_gpu_bytes: budgets.maxGpuBytes,
      gpu_vertex_bytes: budgets.gpuVertexBytes,
      gpu_face_bytes: budgets.gpuFaceBytes,
    },
    credit_bytes: options.creditBytes,
    release_factor: options.releaseFactor,
    held: heldRows,
    timings: true,
  };
}
