/** A group that goes together, as one of its members sees it (protocol, section 10). */

/** A guide moves the group; there is one at most. */
export type GroupRole = "guide" | "member";

/** Somebody in the group. */
export interface GroupMember {
  /** Number in the group, never given again in it. */
  readonly member: number;
  /** What he calls himself: text from a stranger. */
  readonly name: string | null;
  readonly role: GroupRole;
  /** False where his connection is lost and his seat is kept. */
  readonly isPresent: boolean;
  /** Centre of his last landing, in metres of the scene frame; null before his first. */
  readonly position: readonly [number, number, number] | null;
}

/** A landing of the whole group. */
export interface Gathering {
  readonly number: number;
  /** The member who asked for it. */
  readonly guide: number;
  readonly position: readonly [number, number, number];
  readonly radiusM: number;
  /** Whether the barrier is open: all have arrived, or nobody waits any more. */
  readonly isOver: boolean;
  /** Members that show their landing; known once it is over. */
  readonly ready: readonly number[];
  readonly degraded: readonly number[];
  readonly missing: readonly number[];
}

/** The group that this session has a seat in. */
export interface GroupFacts {
  readonly name: string;
  /** This session's own number. */
  readonly member: number;
  readonly role: GroupRole;
  readonly members: readonly GroupMember[];
  /** The newest one; null before the first. */
  readonly gathering: Gathering | null;
}

/** What a member does. */
export type GroupCommand =
  /** Take a seat, and leave any other; the connection is made anew, to where the group is. */
  | { readonly type: "join"; readonly group: string; readonly role: GroupRole; readonly name: string | null }
  | { readonly type: "leave" }
  /** The guide alone may: land everybody there. */
  | {
      readonly type: "gather";
      readonly position: readonly [number, number, number];
      readonly radiusM: number;
      /** What may be shown where time is short. */
      readonly innerRadiusM?: number | undefined;
      /** When nobody waits any longer; the server's without it. */
      readonly deadlineMs?: number | undefined;
    }
  /** Tell how this session's own part of a gathering went. */
  | { readonly type: "arrive"; readonly gathering: number; readonly state: "ready" | "degraded" | "declined" };

/** What has changed of a group. */
export type GroupNews = "joined" | "roster" | "called" | "gathered" | "left" | "refused";

/** Why a join or gather came to nothing. */
export interface GroupRefusal {
  readonly request: number;
  /** An error code of the protocol. */
  readonly code: string;
  readonly message: string;
}

/** The group as it is now; null without a seat. Comes after every change. */
export interface GroupEvent {
  readonly type: "group";
  readonly news: GroupNews;
  readonly group: GroupFacts | null;
  /** With `refused`. */
  readonly refusal: GroupRefusal | null;
}
