/** The messages of protocol 2 (spec/protocol.md, sections 3 and 10). */

import { DecodeError } from "./errors.ts";
import {
  BINARY,
  choice,
  FieldError,
  type Fields,
  FLAG,
  integer,
  keys,
  list,
  number,
  numberMap,
  optional,
  part,
  readFields,
  readKey,
  rows,
  type SegmentKey,
  text,
  triple,
  type ValuesOf,
  writeFields,
} from "./kinds.ts";
import { type Plain, readMsgpack, show, writeMsgpack } from "./msgpack.ts";

export const SUBPROTOCOL = "terraport.v2.msgpack";
/** Most keys in `have`. */
export const MAX_HAVE = 4096;
/** Most keys in `without`. */
export const MAX_WITHOUT = 64;
const MAX_SERVER_MESSAGE_BYTES = 8 * 2 ** 20;
const MAX_PLAN_SEGMENTS = 16_384;
const MAX_COORDINATE_M = 1e7;
const MAX_RADIUS_M = 1e6;
const MAX_MEMBERS = 1024;

const U32 = integer(0, 2 ** 32 - 1);
const NUMBER_FROM_1 = integer(1, 2 ** 32 - 1);
const COUNT = integer(0, Number.MAX_SAFE_INTEGER);
const RADIUS = number(0, MAX_RADIUS_M, true);
const POSITION = triple(MAX_COORDINATE_M);
const NAME = /^[a-z][a-z0-9_]*$/;
const GROUP = text(64, 1, /^[A-Za-z0-9_.~-]+$/);
const ROLE = choice("guide", "member");
const MEMBERS = rows<number>(
  4,
  MAX_MEMBERS,
  (view, at) => view.getUint32(at, true),
  () => undefined,
);

/** A row of `plan.show`. */
export interface PlanRow {
  readonly key: SegmentKey;
  readonly id: number;
  readonly bytes: number;
  readonly faces: number;
  readonly vertices: number;
  /** Its key was not in `have`: it is sent. */
  readonly follows: boolean;
  readonly isCoarser: boolean;
}

const SEGMENTS = rows<PlanRow>(
  28,
  MAX_PLAN_SEGMENTS,
  (view, at) => {
    const [id, bytes, faces, vertices, flags] = [8, 12, 16, 20, 24].map((offset) => view.getUint32(at + offset, true));
    const isCoarser = (flags! & 2) !== 0;
    return {
      key: readKey(view, at),
      id: id!,
      bytes: bytes!,
      faces: faces!,
      vertices: vertices!,
      follows: (flags! & 1) !== 0,
      isCoarser,
    };
  },
  () => {
    throw new FieldError("got a plan to send, expected to receive it");
  },
);

const PLACE = {
  generation: U32,
  position: POSITION,
  radius_m: RADIUS,
  coarse_radius_m: optional(RADIUS),
  have: keys(MAX_HAVE),
  without: optional(keys(MAX_WITHOUT)),
  taken_bytes: COUNT,
};

const CLIENT = {
  hello: {
    client: text(128),
    token: optional(text(4096)),
    budgets: part({
      max_triangles: optional(COUNT),
      max_bytes: optional(COUNT),
      max_segments: optional(COUNT),
      max_gpu_bytes: optional(COUNT),
      gpu_vertex_bytes: optional(integer(1, 4096)),
      gpu_face_bytes: optional(integer(1, 4096)),
    }),
    credit_bytes: COUNT,
  },
  land: { ...PLACE, inner_radius_m: optional(RADIUS) },
  prefetch: PLACE,
  credit: { bytes: integer(1, Number.MAX_SAFE_INTEGER) },
  pick: { request: U32, origin: POSITION, direction: optional(POSITION) },
  bye: {},
  join: { request: U32, group: GROUP, role: ROLE, name: optional(text(64, 1)), seat: optional(text(64, 1)) },
  leave: {},
  gather: {
    request: U32,
    position: POSITION,
    radius_m: RADIUS,
    inner_radius_m: optional(RADIUS),
    deadline_ms: optional(integer(1, 600_000)),
  },
  arrived: { gathering: NUMBER_FROM_1, state: choice("ready", "degraded", "declined") },
};

const SERVER = {
  welcome: {
    server: text(128),
    session: text(64),
    scene: part({
      id: text(128, 1),
      name: text(256),
      version: text(64, 1),
      segment_count: U32,
      base_faces: U32,
      levels: integer(1, 2),
    }),
    limits: part({
      max_radius_m: number(0, MAX_RADIUS_M),
      max_message_bytes: integer(1, Number.MAX_SAFE_INTEGER),
      max_messages_per_s: number(0, 1e9),
      max_credit_bytes: integer(1, Number.MAX_SAFE_INTEGER),
      idle_timeout_s: number(0, 1e9),
      groups: choice("none", "here", "query"),
    }),
  },
  plan: {
    generation: U32,
    show: SEGMENTS,
    hidden: BINARY,
    inner_count: optional(integer(0, MAX_PLAN_SEGMENTS)),
    inner_hidden: optional(BINARY),
    effective_radius_m: number(0, MAX_RADIUS_M),
    omitted: U32,
    omitted_by: optional(choice("max_triangles", "max_bytes", "max_segments", "max_gpu_bytes")),
    pack: optional(text(201)),
    offsets: optional(
      rows<number>(
        8,
        MAX_PLAN_SEGMENTS,
        (view, at) => Number(view.getBigUint64(at, true)),
        () => undefined,
      ),
    ),
  },
  ready: { generation: U32, missing: optional(keys(MAX_PLAN_SEGMENTS)), hidden: optional(BINARY) },
  picked: {
    request: U32,
    hit: optional(
      part({
        position: POSITION,
        normal: triple(1.5),
        segment: U32,
        region: U32,
        stable_id: optional(U32),
        label: optional(text(256)),
        height_m: number(-1e9, 1e9),
        attributes: numberMap(64),
      }),
    ),
  },
  notice: { kind: text(64, 1, NAME), version: optional(text(64)), reconnect_after_ms: optional(COUNT) },
  error: {
    code: text(64, 1, NAME),
    message: text(1024),
    fatal: FLAG,
    generation: optional(U32),
    request: optional(U32),
  },
  joined: { request: U32, group: GROUP, member: NUMBER_FROM_1, role: ROLE, seat: text(64, 1) },
  roster: {
    group: GROUP,
    members: list(
      part({
        member: NUMBER_FROM_1,
        name: optional(text(64, 1)),
        role: ROLE,
        present: FLAG,
        position: optional(POSITION),
      }),
      MAX_MEMBERS,
    ),
  },
  gathering: {
    gathering: NUMBER_FROM_1,
    guide: NUMBER_FROM_1,
    position: POSITION,
    radius_m: RADIUS,
    inner_radius_m: optional(RADIUS),
    left_ms: optional(integer(0, 600_000)),
  },
  gathered: { gathering: NUMBER_FROM_1, ready: MEMBERS, degraded: MEMBERS, missing: MEMBERS },
};

type Of<Table, T extends keyof Table> = { readonly type: T } & ValuesOf<Table[T]>;

/** A message from a client, by its type. */
export type ClientMessage<T extends keyof typeof CLIENT = keyof typeof CLIENT> = {
  [N in T]: Of<typeof CLIENT, N>;
}[T];

/** A message from the service, by its type. */
export type ServerMessage<T extends keyof typeof SERVER = keyof typeof SERVER> = {
  [N in T]: Of<typeof SERVER, N>;
}[T];

/**
 * Write a message of the client.
 *
 * @throws RangeError for a value that the protocol does not allow.
 */
export function encodeMessage(message: ClientMessage): Uint8Array<ArrayBuffer> {
  const { type } = message;
  try {
    checkRules(message);
    return writeMsgpack(
      writeFields(CLIENT[type] as Fields, message as never, new Map<string, Plain>([["type", type]])),
    );
  } catch (error) {
    if (error instanceof FieldError) throw new RangeError(`${type}.${error.path}: ${error.message}`);
    throw error;
  }
}

/**
 * Read a message of the service; null for a type that is not known, which is skipped.
 *
 * @param data - one whole WebSocket message.
 * @throws DecodeError if it is not a message, too long, or has a field that is missing, mistyped or out of range.
 */
export function decodeMessage(data: Uint8Array | string): ServerMessage | null {
  if (typeof data === "string") throw new DecodeError("malformed", "got a text message, expected a binary one");
  if (data.length > MAX_SERVER_MESSAGE_BYTES) {
    throw new DecodeError("too_large", `got ${data.length} bytes, expected at most ${MAX_SERVER_MESSAGE_BYTES}`);
  }
  const plain = readMsgpack(data);
  const type = plain instanceof Map ? plain.get("type") : undefined;
  if (!(plain instanceof Map) || typeof type !== "string") {
    throw new DecodeError("malformed", `got ${show(plain)}, expected a map with a type`);
  }
  if (!Object.hasOwn(SERVER, type)) return null;
  try {
    return { type, ...readFields(SERVER[type as keyof typeof SERVER] as Fields, plain) } as unknown as ServerMessage;
  } catch (error) {
    if (!(error instanceof FieldError)) throw error;
    throw new DecodeError("invalid_field", `${type}.${error.path}: ${error.message}`);
  }
}

/** The subprotocol entry that carries a token where no header can be set (section 2). */
export function tokenSubprotocol(token: string): string {
  const text = btoa(String.fromCharCode(...new TextEncoder().encode(token)));
  return `terraport.token.${text.replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "")}`;
}

/** Check what no table says: rules between the fields of a message. */
function checkRules(message: ClientMessage): void {
  if (message.type === "pick" && message.direction?.every((part) => part === 0)) {
    throw new FieldError("got (0, 0, 0), expected a direction", "direction");
  }
  if ("inner_radius_m" in message && (message.inner_radius_m ?? 0) > message.radius_m) {
    const got = `got ${message.inner_radius_m}, expected at most radius_m ${message.radius_m}`;
    throw new FieldError(got, "inner_radius_m");
  }
  if ("coarse_radius_m" in message && (message.coarse_radius_m ?? message.radius_m) < message.radius_m) {
    const got = `got ${message.coarse_radius_m}, expected at least radius_m ${message.radius_m}`;
    throw new FieldError(got, "coarse_radius_m");
  }
}
