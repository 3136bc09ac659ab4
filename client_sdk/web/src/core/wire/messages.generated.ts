// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

import type { SegmentFacts, Vec3 } from "../types.ts";
import type { FieldTable, HeldRow, MessageTable, Version } from "./kinds.ts";

/** Version of the protocol that this module speaks: major, minor. */
export const PROTOCOL: Version = [1, 0];

/** The WebSocket subprotocol: its name pins the major version. */
export const SUBPROTOCOL = "terraport.v1.msgpack";

/** Bounds that every speaker keeps (section 12); a server may be stricter. */
export const LIMITS = {
  BLOCK_BYTES: 64,
  HEADER_BYTES: 24,
  MAX_ATTRIBUTES: 64,
  MAX_CHUNK_BYTES: 131048,
  MAX_CLIENT_MESSAGE_BYTES: 1048576,
  MAX_CLIENT_VALUES: 1024,
  MAX_CONTAINER_ITEMS: 16384,
  MAX_COORDINATE_M: 10000000.0,
  MAX_DEADLINE_MS: 600000,
  MAX_DEPTH: 16,
  MAX_FRAME_BYTES: 131072,
  MAX_GPU_ELEMENT_BYTES: 4096,
  MAX_GROUP_MEMBERS: 1024,
  MAX_GROUP_NAME: 64,
  MAX_HEADER_BYTES: 1024,
  MAX_HELD_SEGMENTS: 32768,
  MAX_INTEGER: 9007199254740991,
  MAX_LEVELS: 2,
  MAX_PLAN_SEGMENTS: 16384,
  MAX_RADIUS_M: 1000000.0,
  MAX_RELEASE_FACTOR: 4.0,
  MAX_SEGMENT_BYTES: 67108864,
  MAX_SERVER_MESSAGE_BYTES: 8388608,
  MAX_TOKEN_BYTES: 4096,
} as const;

/** The close code of each error where it is fatal (section 11). */
export const CLOSE_CODES = {
  malformed: 4400,
  invalid_field: 4400,
  out_of_order: 4400,
  radius_too_large: 4400,
  unauthorised: 4401,
  forbidden: 4403,
  unknown_scene: 4404,
  timeout: 4408,
  unsupported_version: 4409,
  unsupported_encoding: 4409,
  too_large: 4413,
  too_many: 4429,
  internal: 4500,
  draining: 4503,
  group_refused: 4403,
} as const;

/** Codes of the `error` message; one that is not here is treated by `fatal` alone. */
export type ErrorCode = keyof typeof CLOSE_CODES;

/** What one landing may hold in all (load and keep together); absent means unlimited. */
export interface BudgetsPart {
  /** Most triangles. */
  readonly max_triangles?: number | undefined;
  /** Most payload bytes. */
  readonly max_bytes?: number | undefined;
  /** Most segments. */
  readonly max_segments?: number | undefined;
  /** Most bytes on the client's GPU (section 6.2). */
  readonly max_gpu_bytes?: number | undefined;
  /** Bytes of a vertex in the client's buffers; absent means 24. */
  readonly gpu_vertex_bytes?: number | undefined;
  /** Bytes of a triangle's three indices in them; absent means 6. */
  readonly gpu_face_bytes?: number | undefined;
}

/** Which scene is served. */
export interface SceneInfoPart {
  /** Id of the scene in URLs. */
  readonly id: string;
  /** Version; changes whenever any byte does. */
  readonly version: string;
  /** Name for people. */
  readonly name: string;
  /** Segments of the scene: ids are below it, those of coarser levels above (section 6.1). */
  readonly segment_count: number;
  /** Levels of every segment; absent means 1. */
  readonly levels?: number | undefined;
}

/** What this server allows on this connection. */
export interface ServerLimitsPart {
  /** Largest radius of aim and land. */
  readonly max_radius_m: number;
  /** Largest message to the server. */
  readonly max_message_bytes: number;
  /** Messages per second, averaged over 10 s. */
  readonly max_messages_per_s: number;
  /** Most segments in hello.held. */
  readonly max_held_segments: number;
  /** Most segments in a plan, as a budget would cut. */
  readonly max_plan_segments: number;
  /** Most outstanding credit; more is clamped. */
  readonly max_credit_bytes: number;
  /** Silence after which the server closes. */
  readonly idle_timeout_s: number;
  /** Whether groups can be joined: `here`; `query`: only where the URL of the stream names the group; `none`. Absent means `none`. */
  readonly groups?: "none" | "here" | "query" | undefined;
}

/** Where a client that pulls fetches payload. */
export interface PullInfoPart {
  /** Base address, ending in `/`: `http` or `https`, or relative to the server URL. */
  readonly base: string;
  /** Path of the pack below the base address; its bytes never change. */
  readonly pack: string;
  /** Length of the pack. */
  readonly pack_bytes: number;
}

/** When the server did what for one landing, in microseconds since it received land. */
export interface TimingsPart {
  /** Plan handed to the socket; absent where the plan was still waiting for that. */
  readonly plan_us?: number | undefined;
  /** First chunk on its way; absent where there was none. */
  readonly first_byte_us?: number | undefined;
  /** Last chunk on its way; absent where there was none. */
  readonly last_byte_us?: number | undefined;
  /** Ready decided. */
  readonly ready_us: number;
  /** How long there was payload to send and no credit: time that the client took. */
  readonly credit_wait_us: number;
}

/** What a pick met. */
export interface HitPart {
  /** Point of the surface, metres of the scene frame. */
  readonly position: Vec3;
  /** Unit normal of the face. */
  readonly normal: Vec3;
  /** Segment of the face. */
  readonly segment: number;
  /** Region of the face, in this scene version. */
  readonly region: number;
  /** Number of the region that is the same in every version of the scene, where it has one. */
  readonly stable_id?: number | undefined;
  /** Label of the region when the pick is answered, where it has one. */
  readonly label?: string | undefined;
  /** Height in metres in the survey's own vertical reference. */
  readonly height_m: number;
  /** Survey attributes there, without gaps. */
  readonly attributes: Readonly<Record<string, number>>;
}

/** One seat of a group. */
export interface MemberPart {
  /** Number in the group, never given again in it. */
  readonly member: number;
  /** What it calls itself, for people. */
  readonly name?: string | undefined;
  /** A group has one guide at most. */
  readonly role: "guide" | "member";
  /** False where its connection is lost and its seat is kept. */
  readonly present: boolean;
  /** Centre of its last landing, metres of the scene frame (x, y, z); absent before the first. */
  readonly position?: Vec3 | undefined;
}

/** First message of a connection: who the client is, what it can take, what it holds. */
export interface HelloMessage {
  readonly type: "hello";
  /** Newest version that the client speaks. */
  readonly protocol: Version;
  /** Name and version of the client, for logs. */
  readonly client: string;
  /** Bearer token, where it was not given before. */
  readonly token?: string | undefined;
  /** Payload encoding that the client wants. */
  readonly encoding: "segment-2";
  /** Hard bounds of every landing. */
  readonly budgets: BudgetsPart;
  /** First credit: payload bytes that may be sent at once. */
  readonly credit_bytes: number;
  /** Release radius / load radius; absent means the server's default. */
  readonly release_factor?: number | undefined;
  /** Scene version that the client knows; absent means the newest. */
  readonly scene_version?: string | undefined;
  /** Segments that the client holds whole, with their hashes. */
  readonly held?: readonly HeldRow[] | undefined;
  /** How payload comes: `push`, in frames of this connection; `pull`, fetched by the client (section 17). Absent means `push`. */
  readonly delivery?: "push" | "pull" | undefined;
  /** True: send timings with every ready; absent means false. */
  readonly timings?: boolean | undefined;
}

/** The user points at a place: send ahead, at low priority, what a landing there needs. */
export interface AimMessage {
  readonly type: "aim";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** Centre in metres of the scene frame (x, y, z). */
  readonly position: Vec3;
  /** Radius in metres around the centre. */
  readonly radius_m: number;
  /** Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m. */
  readonly coarse_radius_m?: number | undefined;
}

/** The user teleports: answer with one plan, send its segments, say ready. */
export interface LandMessage {
  readonly type: "land";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** Centre in metres of the scene frame (x, y, z). */
  readonly position: Vec3;
  /** Radius in metres around the centre. */
  readonly radius_m: number;
  /** Radius in metres of the degraded set; at most radius_m. */
  readonly inner_radius_m?: number | undefined;
  /** Milliseconds after which the inner set alone is acceptable; needs inner_radius_m. */
  readonly deadline_ms?: number | undefined;
  /** Milliseconds without progress after which it is, too; needs inner_radius_m. */
  readonly stall_ms?: number | undefined;
  /** Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m. */
  readonly coarse_radius_m?: number | undefined;
}

/** Grant more payload bytes. */
export interface CreditMessage {
  readonly type: "credit";
  /** Payload bytes granted beyond what was before. */
  readonly bytes: number;
}

/** The client no longer holds these segments. */
export interface EvictMessage {
  readonly type: "evict";
  /** Segments no longer held. */
  readonly segments: readonly number[];
}

/** A segment arrived whole but is not usable. */
export interface RejectMessage {
  readonly type: "reject";
  /** Generation of the segment's last frame. */
  readonly generation: number;
  /** The segment. */
  readonly segment: number;
  /** `hash_mismatch`, `undecodable`, or another word for logs. */
  readonly reason: string;
}

/** Ask what lies along a ray, or above or below a point. */
export interface PickMessage {
  readonly type: "pick";
  /** Number chosen by the client, for the answer. */
  readonly request: number;
  /** Point in metres of the scene frame. */
  readonly origin: Vec3;
  /** Direction of the ray, of any length; absent: the vertical line through origin. */
  readonly direction?: Vec3 | undefined;
}

/** More of what the client holds, after hello and before the first aim or land. */
export interface HeldMessage {
  readonly type: "held";
  /** Segments that the client holds whole, with their hashes. */
  readonly segments: readonly HeldRow[];
}

/** The client ends the session; the server closes with 1000. */
export interface ByeMessage {
  readonly type: "bye";
}

/** Take a seat in a group of this scene; it is made if there is none of that name. */
export interface JoinMessage {
  readonly type: "join";
  /** Number chosen by the client, for the answer. */
  readonly request: number;
  /** Name of the group, within the scene. */
  readonly group: string;
  /** A guide moves the group; one at most. */
  readonly role: "guide" | "member";
  /** What the others call this member. */
  readonly name?: string | undefined;
  /** Secret of the seat held before, to take it again after a lost connection. */
  readonly seat?: string | undefined;
}

/** Give up the seat in the group. */
export interface LeaveMessage {
  readonly type: "leave";
}

/** The guide lands the group. */
export interface GatherMessage {
  readonly type: "gather";
  /** Number chosen by the client, for the answer. */
  readonly request: number;
  /** Centre in metres of the scene frame (x, y, z). */
  readonly position: Vec3;
  /** Radius in metres around the centre. */
  readonly radius_m: number;
  /** Radius in metres of the degraded set; at most radius_m. */
  readonly inner_radius_m?: number | undefined;
  /** Milliseconds after which the barrier opens without who is missing; absent means the server's default. */
  readonly deadline_ms?: number | undefined;
}

/** A member's part of a group landing is over. */
export interface ArrivedMessage {
  readonly type: "arrived";
  /** Number of the group landing, chosen by the server. */
  readonly gathering: number;
  /** `ready`: shows its landing; `degraded`: its inner set; `declined`: will not come. */
  readonly state: "ready" | "degraded" | "declined";
}

/** Answer to hello: the session is open. */
export interface WelcomeMessage {
  readonly type: "welcome";
  /** Version spoken from now on. */
  readonly protocol: Version;
  /** Name and version of the server. */
  readonly server: string;
  /** Id of the session, for logs of both sides. */
  readonly session: string;
  /** The scene. */
  readonly scene: SceneInfoPart;
  /** What the server allows. */
  readonly limits: ServerLimitsPart;
  /** Release radius / load radius in use. */
  readonly release_factor: number;
  /** Offered segments that this scene version does not have; the client frees them. */
  readonly dropped: readonly number[];
  /** Offered segments that are accepted as held. */
  readonly held_count: number;
  /** Where payload is fetched; present where hello asked for `pull` and the server grants it. */
  readonly pull?: PullInfoPart | undefined;
}

/** Answer to held: what of it is accepted. */
export interface HeldCheckedMessage {
  readonly type: "held_checked";
  /** Offered segments that this scene version does not have; the client frees them. */
  readonly dropped: readonly number[];
  /** Segments that are held by now. */
  readonly held_count: number;
}

/** Answer to land: the one set of segments of this landing. */
export interface PlanMessage {
  readonly type: "plan";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** Centre, as received. */
  readonly position: Vec3;
  /** Radius in metres around the centre. */
  readonly radius_m: number;
  /** Radius in metres within which held segments are kept. */
  readonly release_radius_m: number;
  /** Everything nearer than this is shown: the largest radius, or less where a budget cut. */
  readonly effective_radius_m: number;
  /** Segments of the plan within inner_radius_m. */
  readonly inner_count: number;
  /** Segments within radius_m that follow, in sending order. */
  readonly load: readonly SegmentFacts[];
  /** Segments within radius_m that the client holds. */
  readonly keep: readonly number[];
  /** Held segments beyond radius_m within release_radius_m: kept, not shown. */
  readonly nearby: readonly number[];
  /** Payload bytes of load, whole segments. */
  readonly load_bytes: number;
  /** Triangles of load. */
  readonly load_triangles: number;
  /** Payload bytes of load and keep. */
  readonly total_bytes: number;
  /** Triangles of load and keep. */
  readonly total_triangles: number;
  /** Segments within radius_m that a budget left out. */
  readonly omitted_segments: number;
  /** Budget that the first omitted segment would exceed; absent if none was omitted. */
  readonly omitted_by?: "max_triangles" | "max_bytes" | "max_segments" | "max_gpu_bytes" | undefined;
  /** GPU bytes of load, keep and nearby; present where hello bounds them. */
  readonly total_gpu_bytes?: number | undefined;
  /** With `pull`: where the payload of each row begins in the pack, in blocks of 64 bytes. */
  readonly blocks?: readonly number[] | undefined;
}

/** Answer to aim: what is sent ahead. */
export interface PrefetchMessage {
  readonly type: "prefetch";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** Segments, in sending order. */
  readonly segments: readonly SegmentFacts[];
  /** Payload bytes of segments, whole. */
  readonly bytes: number;
  /** With `pull`: where the payload of each row begins in the pack, in blocks of 64 bytes. */
  readonly blocks?: readonly number[] | undefined;
}

/** Every segment of the plan was sent whole, or is listed as missing. */
export interface ReadyMessage {
  readonly type: "ready";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** Segments of load that were sent whole. */
  readonly delivered: number;
  /** Payload bytes sent in this generation's frames. */
  readonly payload_bytes: number;
  /** Segments of the plan that cannot be delivered. */
  readonly missing: readonly number[];
  /** Where hello asked for them. */
  readonly timings?: TimingsPart | undefined;
}

/** The deadline has passed and the inner set is whole; streaming goes on to ready. */
export interface DegradedMessage {
  readonly type: "degraded";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** The inner set: what may be shown already. */
  readonly segments: readonly number[];
}

/** An unfinished generation was ended by a newer one. */
export interface SupersededMessage {
  readonly type: "superseded";
  /** Number of the aim or land; strictly increasing on one connection. */
  readonly generation: number;
  /** The newer generation. */
  readonly by: number;
  /** Payload bytes that were not sent. */
  readonly unsent_bytes: number;
}

/** Answer to pick. */
export interface PickedMessage {
  readonly type: "picked";
  /** Request, as received. */
  readonly request: number;
  /** What was met; absent if nothing was. */
  readonly hit?: HitPart | undefined;
}

/** News that ends nothing by itself; a client skips kinds that it does not know. */
export interface NoticeMessage {
  readonly type: "notice";
  /** `draining`: reconnect soon; `scene_published`: a newer version is served. */
  readonly kind: string;
  /** Version of the new scene. */
  readonly version?: string | undefined;
  /** Milliseconds to wait before reconnecting. */
  readonly reconnect_after_ms?: number | undefined;
}

/** Something was refused or failed. */
export interface ErrorMessage {
  readonly type: "error";
  /** Stable code, see the error codes. */
  readonly code: string;
  /** What was received and what was expected, for people. */
  readonly message: string;
  /** True: the server closes with the code's close code. */
  readonly fatal: boolean;
  /** Generation of the refused aim or land. */
  readonly generation?: number | undefined;
  /** Request of the refused pick, join or gather. */
  readonly request?: number | undefined;
  /** With unsupported_version: the versions offered. */
  readonly protocols?: readonly Version[] | undefined;
}

/** Answer to join: the seat in the group. */
export interface JoinedMessage {
  readonly type: "joined";
  /** Request, as received. */
  readonly request: number;
  /** Name of the group, within the scene. */
  readonly group: string;
  /** Number of this member in the group. */
  readonly member: number;
  /** As granted. */
  readonly role: "guide" | "member";
  /** Secret by which this seat is taken again, for this client alone. */
  readonly seat: string;
}

/** Who is in the group, newest state; the ones between may be left out. */
export interface RosterMessage {
  readonly type: "roster";
  /** Name of the group, within the scene. */
  readonly group: string;
  /** All seats, ascending number. */
  readonly members: readonly MemberPart[];
}

/** The guide lands the group: land there, then say arrived. */
export interface GatheringMessage {
  readonly type: "gathering";
  /** Number of the group landing, chosen by the server. */
  readonly gathering: number;
  /** Number of the member who asked for it. */
  readonly guide: number;
  /** Centre in metres of the scene frame (x, y, z). */
  readonly position: Vec3;
  /** Radius in metres around the centre. */
  readonly radius_m: number;
  /** Radius in metres of the degraded set. */
  readonly inner_radius_m?: number | undefined;
  /** Milliseconds until the barrier opens at the latest; absent where it has: nobody waits. */
  readonly left_ms?: number | undefined;
}

/** The barrier is open: everybody has arrived, or the deadline has passed. */
export interface GatheredMessage {
  readonly type: "gathered";
  /** Number of the group landing, chosen by the server. */
  readonly gathering: number;
  /** Members that show their landing. */
  readonly ready: readonly number[];
  /** Members that show the inner set. */
  readonly degraded: readonly number[];
  /** Members that declined, or did not arrive in time. */
  readonly missing: readonly number[];
}

/** Everything that is sent in one direction. */
export type ClientMessage =
  | HelloMessage
  | AimMessage
  | LandMessage
  | CreditMessage
  | EvictMessage
  | RejectMessage
  | PickMessage
  | HeldMessage
  | ByeMessage
  | JoinMessage
  | LeaveMessage
  | GatherMessage
  | ArrivedMessage;

/** Everything that is sent in one direction. */
export type ServerMessage =
  | WelcomeMessage
  | HeldCheckedMessage
  | PlanMessage
  | PrefetchMessage
  | ReadyMessage
  | DegradedMessage
  | SupersededMessage
  | PickedMessage
  | NoticeMessage
  | ErrorMessage
  | JoinedMessage
  | RosterMessage
  | GatheringMessage
  | GatheredMessage;

/** Messages with a rule between fields, which no table can say. */
export type MessageWithRule = "aim" | "land" | "gather" | "plan" | "prefetch";

/** Fields of the maps that stand inside messages. */
export const PARTS = {
  budgets: [
    { name: "max_triangles", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "max_bytes", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "max_segments", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "max_gpu_bytes", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "gpu_vertex_bytes", required: false, kind: { name: "integer", low: 1, high: 4096 } },
    { name: "gpu_face_bytes", required: false, kind: { name: "integer", low: 1, high: 4096 } },
  ],
  sceneinfo: [
    { name: "id", required: true, kind: { name: "text", shortest: 1, longest: 128, pattern: null } },
    { name: "version", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: null } },
    { name: "name", required: true, kind: { name: "text", shortest: 0, longest: 256, pattern: null } },
    { name: "segment_count", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
    { name: "levels", required: false, kind: { name: "integer", low: 1, high: 2 } },
  ],
  serverlimits: [
    { name: "max_radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
    { name: "max_message_bytes", required: true, kind: { name: "integer", low: 1, high: 9007199254740991 } },
    { name: "max_messages_per_s", required: true, kind: { name: "number", low: 0.0, high: 1000000000.0, lowExcluded: true } },
    { name: "max_held_segments", required: true, kind: { name: "integer", low: 0, high: 32768 } },
    { name: "max_plan_segments", required: true, kind: { name: "integer", low: 0, high: 16384 } },
    { name: "max_credit_bytes", required: true, kind: { name: "integer", low: 1, high: 9007199254740991 } },
    { name: "idle_timeout_s", required: true, kind: { name: "number", low: 0.0, high: 1000000000.0, lowExcluded: true } },
    { name: "groups", required: false, kind: { name: "choice", options: ["none", "here", "query"] } },
  ],
  pullinfo: [
    { name: "base", required: true, kind: { name: "text", shortest: 0, longest: 2048, pattern: null } },
    { name: "pack", required: true, kind: { name: "text", shortest: 1, longest: 201, pattern: null } },
    { name: "pack_bytes", required: true, kind: { name: "integer", low: 1, high: 9007199254740991 } },
  ],
  timings: [
    { name: "plan_us", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "first_byte_us", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "last_byte_us", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "ready_us", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    { name: "credit_wait_us", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
  ],
  hit: [
    { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
    { name: "normal", required: true, kind: { name: "position", bound: 1.5, nonzero: false } },
    { name: "segment", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
    { name: "region", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
    { name: "stable_id", required: false, kind: { name: "integer", low: 0, high: 4294967295 } },
    { name: "label", required: false, kind: { name: "text", shortest: 0, longest: 256, pattern: null } },
    { name: "height_m", required: true, kind: { name: "number", low: -1000000000.0, high: 1000000000.0, lowExcluded: false } },
    { name: "attributes", required: true, kind: { name: "numbers", most: 64 } },
  ],
  member: [
    { name: "member", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
    { name: "name", required: false, kind: { name: "text", shortest: 1, longest: 64, pattern: null } },
    { name: "role", required: true, kind: { name: "choice", options: ["guide", "member"] } },
    { name: "present", required: true, kind: { name: "flag" } },
    { name: "position", required: false, kind: { name: "position", bound: 10000000.0, nonzero: false } },
  ],
} as const satisfies Record<string, FieldTable>;

/** Fields of every message, by direction and type, in the order of writing. */
export const MESSAGES: MessageTable = {
  client_to_server: {
    hello: [
      { name: "protocol", required: true, kind: { name: "version" } },
      { name: "client", required: true, kind: { name: "text", shortest: 0, longest: 128, pattern: null } },
      { name: "token", required: false, kind: { name: "text", shortest: 0, longest: 4096, pattern: null } },
      { name: "encoding", required: true, kind: { name: "choice", options: ["segment-2"] } },
      { name: "budgets", required: true, kind: { name: "part", part: "budgets" } },
      { name: "credit_bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "release_factor", required: false, kind: { name: "number", low: 1.0, high: 4.0, lowExcluded: false } },
      { name: "scene_version", required: false, kind: { name: "text", shortest: 0, longest: 64, pattern: null } },
      { name: "held", required: false, kind: { name: "held", most: 32768 } },
      { name: "delivery", required: false, kind: { name: "choice", options: ["push", "pull"] } },
      { name: "timings", required: false, kind: { name: "flag" } },
    ],
    aim: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "coarse_radius_m", required: false, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
    ],
    land: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "inner_radius_m", required: false, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "deadline_ms", required: false, kind: { name: "integer", low: 1, high: 600000 } },
      { name: "stall_ms", required: false, kind: { name: "integer", low: 1, high: 600000 } },
      { name: "coarse_radius_m", required: false, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
    ],
    credit: [
      { name: "bytes", required: true, kind: { name: "integer", low: 1, high: 9007199254740991 } },
    ],
    evict: [
      { name: "segments", required: true, kind: { name: "ids", most: 32768 } },
    ],
    reject: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "segment", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "reason", required: true, kind: { name: "text", shortest: 0, longest: 64, pattern: null } },
    ],
    pick: [
      { name: "request", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "origin", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "direction", required: false, kind: { name: "position", bound: 10000000.0, nonzero: true } },
    ],
    held: [
      { name: "segments", required: true, kind: { name: "held", most: 32768 } },
    ],
    bye: [],
    join: [
      { name: "request", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "group", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: "[A-Za-z0-9_.~-]+" } },
      { name: "role", required: true, kind: { name: "choice", options: ["guide", "member"] } },
      { name: "name", required: false, kind: { name: "text", shortest: 1, longest: 64, pattern: null } },
      { name: "seat", required: false, kind: { name: "text", shortest: 1, longest: 64, pattern: null } },
    ],
    leave: [],
    gather: [
      { name: "request", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "inner_radius_m", required: false, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "deadline_ms", required: false, kind: { name: "integer", low: 1, high: 600000 } },
    ],
    arrived: [
      { name: "gathering", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
      { name: "state", required: true, kind: { name: "choice", options: ["ready", "degraded", "declined"] } },
    ],
  },
  server_to_client: {
    welcome: [
      { name: "protocol", required: true, kind: { name: "version" } },
      { name: "server", required: true, kind: { name: "text", shortest: 0, longest: 128, pattern: null } },
      { name: "session", required: true, kind: { name: "text", shortest: 0, longest: 64, pattern: null } },
      { name: "scene", required: true, kind: { name: "part", part: "sceneinfo" } },
      { name: "limits", required: true, kind: { name: "part", part: "serverlimits" } },
      { name: "release_factor", required: true, kind: { name: "number", low: 1.0, high: 4.0, lowExcluded: false } },
      { name: "dropped", required: true, kind: { name: "ids", most: 32768 } },
      { name: "held_count", required: true, kind: { name: "integer", low: 0, high: 32768 } },
      { name: "pull", required: false, kind: { name: "part", part: "pullinfo" } },
    ],
    held_checked: [
      { name: "dropped", required: true, kind: { name: "ids", most: 32768 } },
      { name: "held_count", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
    ],
    plan: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "release_radius_m", required: true, kind: { name: "number", low: 0.0, high: 4000000.0, lowExcluded: true } },
      { name: "effective_radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: false } },
      { name: "inner_count", required: true, kind: { name: "integer", low: 0, high: 16384 } },
      { name: "load", required: true, kind: { name: "load", most: 16384 } },
      { name: "keep", required: true, kind: { name: "ids", most: 16384 } },
      { name: "nearby", required: true, kind: { name: "ids", most: 16384 } },
      { name: "load_bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "load_triangles", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "total_bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "total_triangles", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "omitted_segments", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "omitted_by", required: false, kind: { name: "choice", options: ["max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"] } },
      { name: "total_gpu_bytes", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "blocks", required: false, kind: { name: "ids", most: 16384 } },
    ],
    prefetch: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "segments", required: true, kind: { name: "load", most: 16384 } },
      { name: "bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "blocks", required: false, kind: { name: "ids", most: 16384 } },
    ],
    ready: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "delivered", required: true, kind: { name: "integer", low: 0, high: 16384 } },
      { name: "payload_bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
      { name: "missing", required: true, kind: { name: "ids", most: 16384 } },
      { name: "timings", required: false, kind: { name: "part", part: "timings" } },
    ],
    degraded: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "segments", required: true, kind: { name: "ids", most: 16384 } },
    ],
    superseded: [
      { name: "generation", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "by", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "unsent_bytes", required: true, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    ],
    picked: [
      { name: "request", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "hit", required: false, kind: { name: "part", part: "hit" } },
    ],
    notice: [
      { name: "kind", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: "[a-z][a-z0-9_]*" } },
      { name: "version", required: false, kind: { name: "text", shortest: 0, longest: 64, pattern: null } },
      { name: "reconnect_after_ms", required: false, kind: { name: "integer", low: 0, high: 9007199254740991 } },
    ],
    error: [
      { name: "code", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: "[a-z][a-z0-9_]*" } },
      { name: "message", required: true, kind: { name: "text", shortest: 0, longest: 1024, pattern: null } },
      { name: "fatal", required: true, kind: { name: "flag" } },
      { name: "generation", required: false, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "request", required: false, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "protocols", required: false, kind: { name: "versions", most: 16 } },
    ],
    joined: [
      { name: "request", required: true, kind: { name: "integer", low: 0, high: 4294967295 } },
      { name: "group", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: "[A-Za-z0-9_.~-]+" } },
      { name: "member", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
      { name: "role", required: true, kind: { name: "choice", options: ["guide", "member"] } },
      { name: "seat", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: null } },
    ],
    roster: [
      { name: "group", required: true, kind: { name: "text", shortest: 1, longest: 64, pattern: "[A-Za-z0-9_.~-]+" } },
      { name: "members", required: true, kind: { name: "parts", part: "member", most: 1024 } },
    ],
    gathering: [
      { name: "gathering", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
      { name: "guide", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
      { name: "position", required: true, kind: { name: "position", bound: 10000000.0, nonzero: false } },
      { name: "radius_m", required: true, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "inner_radius_m", required: false, kind: { name: "number", low: 0.0, high: 1000000.0, lowExcluded: true } },
      { name: "left_ms", required: false, kind: { name: "integer", low: 0, high: 600000 } },
    ],
    gathered: [
      { name: "gathering", required: true, kind: { name: "integer", low: 1, high: 4294967295 } },
      { name: "ready", required: true, kind: { name: "ids", most: 1024 } },
      { name: "degraded", required: true, kind: { name: "ids", most: 1024 } },
      { name: "missing", required: true, kind: { name: "ids", most: 1024 } },
    ],
  },
};
