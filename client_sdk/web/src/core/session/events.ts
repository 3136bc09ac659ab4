/**
 * What the session state machine reports: values, in the order in which they happened.
 *
 * PURE.
 */

import type { PickHit, StreamEvent } from "../types.ts";
import type { PlanMessage, SceneInfoPart, ServerLimitsPart, TimingsPart } from "../wire/messages.generated.ts";
import type { CachedSegment } from "./cache.ts";

export type SessionEvent =
  /** The server said welcome. */
  | {
      readonly type: "opened";
      readonly scene: SceneInfoPart;
      readonly limits: ServerLimitsPart;
      /** The server's name for this session, for logs. */
      readonly session: string;
      /** Offered segments that the server accepted with `hello`. */
      readonly heldCount: number;
      /** An earlier connection of this session served another version. */
      readonly changed: boolean;
    }
  /** Not held any more: not of the served version, or evicted here. */
  | { readonly type: "dropped"; readonly segments: readonly number[] }
  /** A landing has its plan; after a reconnect it gets another one. */
  | { readonly type: "planned"; readonly landing: number; readonly plan: PlanMessage }
  /** One segment is whole and has the right hash; `landing` is null for a prefetched one. */
  | { readonly type: "arrived"; readonly landing: number | null; readonly entry: CachedSegment }
  /** One segment came with a wrong hash, or was kept by the plan and is not here; it was asked for again. */
  | {
      readonly type: "rejected";
      readonly landing: number | null;
      readonly segment: number;
      /** Of what came; null where nothing is here. */
      readonly actual: bigint | null;
      readonly expected: bigint;
    }
  /** The deadline passed and the inner set is whole here; the landing goes on. */
  | { readonly type: "degraded"; readonly landing: number; readonly segments: readonly number[] }
  /** The landing is whole, and is what is visible from now on. */
  | {
      readonly type: "ready";
      readonly landing: number;
      readonly visible: readonly number[];
      readonly missing: readonly number[];
      readonly payloadBytes: number;
      /** When the server did what, where it says so. */
      readonly timings: TimingsPart | null;
    }
  | { readonly type: "superseded"; readonly landing: number; readonly by: number }
  /** An aim is answered: so much is sent ahead. */
  | { readonly type: "prefetching"; readonly aim: number; readonly segments: number; readonly bytes: number }
  /** Everything that an aim brings is here. */
  | { readonly type: "prefetched"; readonly aim: number; readonly segments: number; readonly bytes: number }
  | { readonly type: "pick-answered"; readonly request: number; readonly hit: PickHit | null }
  | { readonly type: "pick-refused"; readonly request: number; readonly code: string; readonly message: string }
  /** The server refused one landing, one aim, or (fatal) the connection. */
  | Extract<StreamEvent, { readonly type: "refused" | "notice" | "group" }>;
