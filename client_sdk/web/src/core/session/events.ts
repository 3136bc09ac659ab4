/** Events of the session, in order. PURE. */

import type { GroupEvent } from "../extras/group-types.ts";
import type { Bounds, PickHit, Vec3 } from "../types.ts";
import type { SegmentKey } from "../wire/kinds.ts";
import type { PlanRow, ServerMessage } from "../wire/messages.ts";

type Bits = Uint8Array<ArrayBuffer>;

export type SessionEvent =
  /** The server said welcome. `changed`: an earlier connection of this session served another version. */
  | {
      readonly type: "opened";
      readonly scene: ServerMessage<"welcome">["scene"];
      readonly limits: ServerMessage<"welcome">["limits"];
      readonly session: string;
      readonly changed: boolean;
    }
  /** A landing has its plan; when it is requested again, it gets another one. */
  | {
      readonly type: "planned";
      readonly landing: number;
      readonly position: Vec3;
      readonly radiusM: number;
      readonly plan: ServerMessage<"plan">;
    }
  /** A payload is whole. The owner answers with `checked` or `damaged`. */
  | { readonly type: "whole"; readonly key: SegmentKey; readonly payload: Uint8Array<ArrayBuffer> }
  /** A payload was checked; `landing` is null where no planned landing waits for it. */
  | {
      readonly type: "arrived";
      readonly landing: number | null;
      readonly key: SegmentKey;
      readonly bytes: number;
      readonly bounds: Bounds;
    }
  /** The landing may show its inner set, which is complete. `hidden`: base faces, one bit each, in a gzip stream. */
  | {
      readonly type: "degraded";
      readonly landing: number;
      readonly rows: readonly PlanRow[];
      readonly hidden: Bits;
    }
  /** The landing is complete, and is what is shown from now on. */
  | {
      readonly type: "ready";
      readonly landing: number;
      readonly rows: readonly PlanRow[];
      /** Segments that could not be delivered, or not be used. */
      readonly missing: readonly SegmentKey[];
      readonly hidden: Bits;
      readonly payloadBytes: number;
    }
  | { readonly type: "superseded"; readonly landing: number; readonly by: number }
  /** The server refused one landing, or (fatal) the connection. */
  | {
      readonly type: "refused";
      readonly code: string;
      readonly message: string;
      readonly fatal: boolean;
      readonly landing: number | null;
    }
  | { readonly type: "pick-answered"; readonly request: number; readonly hit: PickHit | null }
  | { readonly type: "pick-refused"; readonly request: number; readonly code: string; readonly message: string }
  | {
      readonly type: "notice";
      readonly kind: string;
      readonly version: string | null;
      readonly reconnectAfterMs: number | null;
    }
  | GroupEvent;
