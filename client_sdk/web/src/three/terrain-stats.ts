/** Figures of a terrain: what it holds and has done. */

import type { Stream, StreamStats } from "../core/types.ts";
import type { BaseGround } from "./base-ground.ts";
import type { FaceBoxes } from "./face-boxes.ts";
import type { FrameTimes } from "./frame-times.ts";
import type { GpuStore } from "./gpu-store.ts";
import type { SegmentSet } from "./segment-set.ts";
import type { TerrainStats } from "./types.ts";

/** How old the stream's counters may be. */
const STREAM_EVERY_MS = 500;

/** The stream's counters, asked for now and then: they lie in another thread. */
export class StreamCounters {
  readonly #stream: Stream;
  #newest: StreamStats | null = null;
  #askedAtMs = Number.NEGATIVE_INFINITY;

  constructor(stream: Stream) {
    this.#stream = stream;
  }

  /** The last there are; null before the first. */
  read(nowMs: number): StreamStats | null {
    if (nowMs - this.#askedAtMs > STREAM_EVERY_MS) {
      this.#askedAtMs = nowMs;
      this.#stream.stats().then(
        (stats) => {
          this.#newest = stats;
        },
        () => undefined, // A closed stream counts nothing any more; the last figures stay.
      );
    }
    return this.#newest;
  }
}

/** The figures of what is drawn now. */
export function terrainStats(
  stream: StreamStats | null,
  store: GpuStore,
  base: BaseGround,
  baseBoxes: FaceBoxes,
  segments: SegmentSet,
  times: FrameTimes,
): TerrainStats {
  const { bufferBytes, textureBytes, createdBytes, freedBytes } = store;
  const baseTriangles = base.isUploaded ? base.faceCount - base.hiddenCount : 0;
  return {
    stream,
    gpu: {
      segments: segments.count,
      visibleSegments: segments.shown.size,
      pages: segments.pageCount,
      bufferBytes,
      textureBytes,
      createdBytes,
      freedBytes,
    },
    pickingBytes: baseBoxes.bytes + segments.pickingBytes,
    visibleTriangles: baseTriangles + segments.shownFaces,
    updateMaxMs: times.maxMs,
    updateMedianMs: times.medianMs,
  };
}
