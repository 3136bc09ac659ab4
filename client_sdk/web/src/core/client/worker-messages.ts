/** What passes between the page, the stream's worker and the decode workers. */

import type { GroupCommand } from "../extras/group-types.ts";
import type {
  AttributeScale,
  LandOptions,
  MeshData,
  PickHit,
  SceneFiles,
  SegmentKey,
  StreamEvent,
  StreamOptions,
  StreamStats,
  Vec3,
} from "../types.ts";
import type { SentError } from "./worker-errors.ts";

/** Page to stream worker; `open` comes first and once. */
export type StreamCommand =
  | {
      readonly type: "open";
      /** Without a token where the page has a function, which is asked by `token-wanted`. */
      readonly options: Omit<StreamOptions, "token"> & { readonly token?: string };
      readonly asksForTokens: boolean;
      readonly decoders: number;
    }
  /** Answer to `token-wanted`; without a token where its function failed. */
  | { readonly type: "token"; readonly question: number; readonly token?: string; readonly error?: SentError }
  | {
      readonly type: "land";
      readonly number: number;
      readonly position: Vec3;
      readonly radiusM: number;
      readonly options: LandOptions;
      readonly askedMs: number;
    }
  | {
      readonly type: "aim";
      readonly position: Vec3;
      readonly radiusM: number;
      readonly coarseRadiusM: number | undefined;
    }
  | { readonly type: "group"; readonly command: GroupCommand }
  | { readonly type: "reconnect"; readonly token: string | undefined }
  | { readonly type: "close" }
  | StreamQuestion;

/** Those that have an answer. */
export type StreamQuestion =
  | { readonly type: "pick"; readonly id: number; readonly origin: Vec3; readonly direction: Vec3 | undefined }
  | {
      readonly type: "mesh";
      readonly id: number;
      readonly key: SegmentKey;
      readonly attributes: readonly AttributeScale[];
    }
  | { readonly type: "stats"; readonly id: number };

/** Stream worker to page. */
export type StreamMessage =
  | { readonly type: "event"; readonly event: StreamEvent }
  | { readonly type: "answer"; readonly id: number; readonly value: StreamAnswer }
  | { readonly type: "failed"; readonly id: number; readonly error: SentError }
  /** The page's function is asked for the present token. */
  | { readonly type: "token-wanted"; readonly question: number }
  /** The worker cannot go on. */
  | { readonly type: "crashed"; readonly error: SentError }
  /** Goodbye was said; the worker may be ended. */
  | { readonly type: "closed" };

export type StreamAnswer = PickHit | MeshData | StreamStats | null;

/** Stream worker to decode worker. */
export interface DecodeJob {
  readonly payload: Uint8Array<ArrayBuffer>;
  readonly attributes: readonly AttributeScale[];
}

/** Decode worker to stream worker: one for each job, in order. */
export type DecodeAnswer =
  | { readonly type: "decoded"; readonly mesh: MeshData }
  | { readonly type: "failed"; readonly error: SentError };

/** Page to scene worker, once. */
export interface SceneJob {
  readonly sceneUrl: string;
  readonly token: string | undefined;
  readonly version: string | undefined;
  readonly wantsOverview: boolean;
}

/** Scene worker to page. */
export type SceneMessage =
  | { readonly type: "progress"; readonly doneBytes: number; readonly totalBytes: number }
  /** `overview` comes once at most, and not last. */
  | { readonly type: "overview"; readonly files: SceneFiles }
  | { readonly type: "loaded"; readonly files: SceneFiles }
  | { readonly type: "failed"; readonly error: SentError };
