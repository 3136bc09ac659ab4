/**
 * The values that pass between the parts of the viewer.
 *
 * Lengths are metres of the scene frame (right-handed, Y up, about the scene's origin). No three.js, no DOM.
 */

import type { GroupCommand, GroupEvent } from "./extras/group-types.ts";
import type { SegmentKey } from "./wire/kinds.ts";

export type * from "./extras/stroke-types.ts";
export type { SegmentKey };

/** Direction in which a coordinate of the survey counts. */
export type SurveyAxis = "east" | "west" | "north" | "south" | "up" | "down";

/** x, y, z in metres of the scene frame. */
export type Vec3 = readonly [number, number, number];

/** minimum x, y, z, maximum x, y, z. */
export type Bounds = readonly [number, number, number, number, number, number];

/** A segment that a landing shows. Plain values: an event can be written as JSON, except for bit sets. */
export interface SegmentFacts {
  readonly key: SegmentKey;
  /** Number of the segment in this version of the scene, at whichever level. */
  readonly segment: number;
  /** Whether it is the coarser level of it. */
  readonly isCoarser: boolean;
  /** Payload bytes. */
  readonly bytes: number;
  readonly faces: number;
  readonly vertices: number;
  /** Whether it was not here when the landing was requested. */
  readonly follows: boolean;
}

/** Faces of the base mesh, one bit each, the lowest bit first: 1 where a face is hidden. */
export type FaceBits = Uint8Array<ArrayBuffer>;

/** Hard bounds of every landing; an absent one does not bound. */
export interface Budgets {
  readonly maxTriangles?: number;
  readonly maxBytes?: number;
  readonly maxSegments?: number;
  /** On the client's GPU; with it what a vertex and a triangle's indices take there (protocol, section 3). */
  readonly maxGpuBytes?: number;
  readonly gpuVertexBytes?: number;
  readonly gpuFaceBytes?: number;
}

/** How 16-bit codes of a survey attribute become values: offset + step * code; code 65535 means "no value". */
export interface AttributeScale {
  readonly name: string;
  readonly offset: number;
  readonly step: number;
}

/** One survey attribute of a mesh. */
export interface AttributeCodes extends AttributeScale {
  /** Two entries per vertex (stride 4 bytes): the code, and padding. */
  readonly codes: Uint16Array;
}

/** A photograph's piece, decoded off the main thread. */
export interface MeshImage {
  readonly mediaType: string;
  readonly width: number;
  readonly height: number;
  readonly pixels: ImageBitmap | CompressedImage;
}

/** An image as a GPU keeps it, all levels down to 1 x 1. */
export interface CompressedImage {
  readonly width: number;
  readonly height: number;
  /** WebGL's number of the form, sRGB. */
  readonly form: number;
  /** WebGL extension that knows the form; null where none is needed. */
  readonly extension: string | null;
  readonly levels: readonly Uint8Array<ArrayBuffer>[];
}

/**
 * A decoded payload, or the base mesh: what the GPU is given. Arrays are transferable and owned by the receiver.
 *
 * A vertex's place is `translation + stepM * position`, exact in float32; for float positions the translation is 0 and
 * the step 1.
 */
export interface MeshData {
  readonly vertexCount: number;
  readonly faceCount: number;
  readonly translation: Vec3;
  readonly stepM: number;
  /** Uint16: four entries per vertex, the fourth is padding. Float32: three entries per vertex. */
  readonly positions: Uint16Array | Float32Array;
  /** Four entries per vertex, the fourth is padding; normalised (127 is 1). */
  readonly normals: Int8Array;
  /** Four entries per vertex, linear light, normalised (65535 is 1); null without colour. */
  readonly colours: Uint16Array | null;
  /** Two entries per vertex; a texture coordinate is `uvScale * code`; null without a texture. */
  readonly uvs: Uint16Array | null;
  readonly uvScale: readonly [number, number];
  /** Two entries per vertex: region id, and padding; null without regions. */
  readonly regionIds: Uint16Array | null;
  readonly attributes: readonly AttributeCodes[];
  /** Three entries per face, counter-clockwise from outside. */
  readonly indices: Uint16Array | Uint32Array;
  readonly image: MeshImage | null;
  /** Box of the decoded positions. */
  readonly bounds: Bounds;
}

/** A value that the survey has at its points. */
export interface AttributeInfo extends AttributeScale {
  /** Of the encoded values; null when there is none. */
  readonly min: number | null;
  readonly max: number | null;
}

/** What the viewer uses of scene.json. */
export interface SceneManifest {
  readonly id: string;
  readonly name: string;
  readonly version: string;
  readonly crs: { readonly name: string; readonly epsg: number | null } | null;
  /** East, north, height of the frame's origin in the CRS, metres: E = E0 + x, N = N0 - z, H = H0 + y. */
  readonly origin: Vec3;
  /** Metres in one unit of the survey's own coordinates; null where they are metres. */
  readonly surveyUnits: {
    readonly horizontalM: number;
    readonly heightM: number;
    /** Directions of x, y and z of the survey, where they are not east, north and up. */
    readonly axes?: readonly [SurveyAxis, SurveyAxis, SurveyAxis];
  } | null;
  readonly stepM: number;
  readonly bounds: Bounds;
  readonly attributes: readonly AttributeInfo[];
  readonly segmentCount: number;
  /** Levels of every segment: 1, or 2 with a coarser one. */
  readonly levels: number;
  readonly detailFaces: number;
  /** Whether every segment has vertex colours, and the base those or a texture. */
  readonly hasColour: boolean;
  /** What the textures show, be it the base's alone; null without any, or where none can be opened here. */
  readonly texturesOf: "photos" | "points" | null;
  /** How far the base is drawn pushed back along the line of sight, metres. */
  readonly deviationM: number;
  /** Whether the service lets this token paint strokes; absent where not. */
  readonly mayPaint?: true;
}

/** Pieces that are united, regions by their id or earlier unions by the count of regions and their place, and at what cost. */
export type RegionUnion = readonly [one: number, other: number, cost: number];

/** What a region is united to at some cost: the field's farm, and its valley. */
export interface CoarserPiece {
  /** 1 is what two regions cost no more than. */
  readonly cost: number;
  /** Ids, ascending. */
  readonly regions: readonly number[];
  readonly areaM2: number;
  /** What most of its named ground is called. */
  readonly label: string | null;
}

/** What the viewer uses of one row of regions.json, with the label of labels.json. */
export interface RegionFacts {
  readonly id: number;
  readonly stableId: number | null;
  readonly label: string | null;
  readonly areaM2: number | null;
  readonly meanColour: readonly [number, number, number] | null;
  readonly slopeDeg: number | null;
  readonly centroid: Vec3 | null;
  /** From where it is seen best; null where nobody chose. */
  readonly place: RegionPlace | null;
}

/** Where to stand to see a region. */
export interface RegionPlace {
  /** On the ground. */
  readonly position: Vec3;
  /** Clockwise from north. */
  readonly headingDeg: number;
  readonly radiusM: number;
}

/** Everything that is loaded once for a version of a scene. */
export interface SceneFiles {
  /** `base` is the overview: to be shown until the files without this are here. */
  readonly isOverview?: true;
  readonly manifest: SceneManifest;
  readonly base: MeshData;
  readonly regions: readonly RegionFacts[];
  /** What unites them to coarser pieces; absent or empty where the scene says nothing of it. */
  readonly unions?: readonly RegionUnion[];
}

/** One line of GET /scenes. */
export interface SceneSummary {
  readonly id: string;
  readonly name: string;
  readonly version: string;
  readonly segments: number;
  readonly detailFaces: number;
  /** Of its build's report; "" where the service has none. */
  readonly reportUrl: string;
  /** Of the report to print; "" where the service has none. */
  readonly reportPdfUrl: string;
  /** Of a small picture; "" where the service has none. */
  readonly previewUrl: string;
}

/** A scene that is being built: one line of `building` in GET /scenes. */
export interface BuildingScene {
  readonly id: string;
  readonly name: string;
  /** What the build does just now. */
  readonly step: string;
  /** How far that step is, 0 to 1; null where that is not known. */
  readonly share: number | null;
}

/** Answer to a pick. */
export interface PickHit {
  readonly position: Vec3;
  readonly normal: Vec3;
  readonly segment: number;
  readonly region: number;
  readonly stableId: number | null;
  readonly label: string | null;
  /** Height in the survey's own vertical reference. */
  readonly heightM: number;
  readonly attributes: Readonly<Record<string, number>>;
}

/** A ring of the coarser level, and how long a landing may take before its inner part is shown. */
export interface LandOptions {
  /**
   * Beyond the radius, up to here, segments come at their coarser level, where the scene has one; a larger one than the service
   * allows is cut to that.
   */
  readonly coarseRadiusM?: number | undefined;
  /** What may be shown first when `deadlineMs` have passed in all, or `stallMs` without a segment; at most the radius. */
  readonly innerRadiusM?: number | undefined;
  readonly deadlineMs?: number | undefined;
  readonly stallMs?: number | undefined;
}

/** The plan of a landing. */
export interface PlanFacts {
  readonly landing: number;
  readonly position: Vec3;
  readonly radiusM: number;
  /** How far full detail reaches: the radius, or less where a budget cut. */
  readonly effectiveRadiusM: number;
  /** How far the coarser level reaches beyond it; null where there is none of it. */
  readonly coarseRadiusM: number | null;
  /** What is shown when all of it is here, nearest first. */
  readonly show: readonly SegmentFacts[];
  /** Base faces that are hidden then. */
  readonly hidden: FaceBits;
  /** Payload bytes that follow, and of all that is shown. */
  readonly loadBytes: number;
  readonly totalBytes: number;
  readonly totalTriangles: number;
  readonly omittedSegments: number;
  readonly omittedBy: string | null;
}

/** Where the connection stands. `attempt` counts from 1; `retryInMs` runs from the event. */
export type LinkState =
  | { readonly state: "connecting"; readonly attempt: number }
  | { readonly state: "open" }
  | {
      readonly state: "waiting";
      readonly attempt: number;
      readonly retryInMs: number;
      readonly closeCode: number;
      readonly code: string;
      readonly message: string;
    }
  /** For good: until `reconnect` is called. `code` is an error code of the protocol, or "closed". */
  | { readonly state: "closed"; readonly closeCode: number; readonly code: string; readonly message: string };

/** What a stream tells. Landing numbers stay the same over reconnects. */
export type StreamEvent =
  | { readonly type: "link"; readonly link: LinkState }
  | {
      readonly type: "opened";
      readonly sceneVersion: string;
      readonly session: string;
      /** Another version is served than before: base and regions must be loaded again (protocol, section 7). */
      readonly changed: boolean;
      readonly maxRadiusM: number;
    }
  | { readonly type: "planned"; readonly plan: PlanFacts }
  /**
   * A segment is here and its checksum is right: it can be asked for by `mesh`. `landing` is null where no plan waits for it: an
   * aim brought it.
   */
  | {
      readonly type: "arrived";
      readonly landing: number | null;
      readonly key: SegmentKey;
      readonly bytes: number;
      readonly bounds: Bounds;
    }
  /** The landing takes long, and its inner part is here: these may be shown first. */
  | {
      readonly type: "degraded";
      readonly landing: number;
      readonly segments: readonly SegmentKey[];
      readonly hidden: FaceBits;
    }
  | {
      readonly type: "ready";
      readonly landing: number;
      /** Exactly what must be shown, nearest first, and the base faces that are hidden with it. */
      readonly visible: readonly SegmentKey[];
      readonly hidden: FaceBits;
      readonly missing: readonly SegmentKey[];
      /**
       * Milliseconds from the call of `land` until all bytes were here and checked, by the clock of the browsing
       * context: it counts the way of the command into the worker, not the way of this event out of it.
       */
      readonly elapsedMs: number;
      /** That moment as `performance.timeOrigin + performance.now()`. */
      readonly readyAtMs: number;
      readonly payloadBytes: number;
    }
  | { readonly type: "superseded"; readonly landing: number; readonly by: number }
  | {
      readonly type: "refused";
      readonly code: string;
      readonly message: string;
      readonly fatal: boolean;
      readonly landing: number | null;
    }
  | GroupEvent
  | {
      readonly type: "notice";
      readonly kind: string;
      readonly version: string | null;
      readonly reconnectAfterMs: number | null;
    };

/** What has been counted since the stream was made. */
export interface StreamStats {
  readonly payloadBytes: number;
  readonly repeatedBytes: number;
  readonly heldSegments: number;
  readonly heldBytes: number;
  /** Landings that had an aim before them, and those of them with nothing left to load. */
  readonly aimedLandings: number;
  readonly aimHits: number;
}

/**
 * A bearer token, or what gives the present one: asked before each connection, and once more where that was refused after a
 * welcome: with another one the session goes on, with everything held. It may ask the page's own server; where it fails, or
 * takes more than 10 s, that counts as a connection that did not come about.
 */
export type Token = string | (() => string | Promise<string>);

/** Which scene is streamed, for whom, and how much of it may be held. */
export interface StreamOptions {
  /** http(s) URL ending in /scenes/{id}. */
  readonly sceneUrl: string;
  readonly token?: Token;
  /** Default: those of a desktop computer (`budgetsFor`). */
  readonly budgets?: Budgets;
  /** Payload bytes kept in memory in addition to those shown. Default: that of a desktop computer. */
  readonly cacheBytes?: number;
  /** Payload bytes kept on disk over all scenes, for the next visit; 0, or no such storage, keeps none. Default 0. */
  readonly diskBytes?: number;
  readonly creditBytes?: number;
  /**
   * Land without a connection: plans are requested over HTTP, and payload by ranges of the pack, which a CDN or object storage may
   * have. There are no picks and no groups then. Default false.
   */
  readonly overHttp?: boolean;
  /** Name and version of the client, for the server's logs. */
  readonly client?: string;
}

/**
 * A session over all its connections, as the page sees it. Made by `openStream` (a worker holds socket, cache and
 * decoders), or `openDirectStream` (the same in this thread). Nothing here blocks.
 */
export interface Stream {
  /** One listener; set it in the same task in which the stream was made. */
  onEvent: (event: StreamEvent) => void;
  /** Ask for a landing; it supersedes any that is not ready. Returns its number in the events. */
  land(position: Vec3, radiusM: number, options?: LandOptions): number;
  /** Tell where the user points; only the newest counts, sent at most ten times a second. */
  aim(position: Vec3, radiusM: number, coarseRadiusM?: number): void;
  /** Resolves with null where nothing is met; rejects with StreamError where refused. */
  pick(origin: Vec3, direction?: Vec3): Promise<PickHit | null>;
  /**
   * Decode a segment that is in memory; rejects with StreamError where it is not, or is not valid: then it is loaded again, or
   * left out of the landing, which has another plan. `attributes` are those of the manifest of the session's version: a payload
   * holds their codes alone.
   */
  mesh(key: SegmentKey, attributes: readonly AttributeScale[]): Promise<MeshData>;
  stats(): Promise<StreamStats>;
  /** Join a group, go with it, or lead it; what comes of it is told by `group` events. */
  group(command: GroupCommand): void;
  /**
   * Connect now, perhaps with another token: after "closed", or to cut a wait short. One that is given here stands for a
   * function from now on.
   */
  reconnect(token?: string): void;
  /** Say bye, free everything. The stream is of no use afterwards. */
  close(): void;
}
