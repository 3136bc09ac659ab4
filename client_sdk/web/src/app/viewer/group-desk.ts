/** Going together: what the group's guide asks is landed at, and the group is told how that went. */

import type { GroupRole } from "../../core/extras/group-types.ts";
import type { Stream, StreamEvent, Vec3 } from "../../core/types.ts";
import type { Announcer } from "../announcer.ts";
import type { ViewerState, ViewerStore } from "./state.ts";

/** What the desk needs. */
export interface GroupDeskOptions {
  readonly store: ViewerStore;
  readonly stream: Pick<Stream, "group">;
  readonly announcer: Pick<Announcer, "announce">;
  /** Land there, and be taken there; returns the landing's number. */
  land(position: Vec3, radiusM: number): number;
}

/** The user's part in a group. */
export interface GroupDesk {
  handle(event: StreamEvent): void;
  join(group: string, role: GroupRole, name: string): void;
  leave(): void;
  /** Bring everybody to where the user has landed. */
  gather(): void;
  /** Go where the guide is, if that was not followed. */
  goThere(): void;
  /** Go where somebody of the group stands, with the radius of one's own landings. */
  goTo(position: Vec3): void;
  dispose(): void;
}

/** Make one; it follows the store. */
export function createGroupDesk({ store, stream, announcer, land }: GroupDeskOptions): GroupDesk {
  /** The newest gathering that was answered, by the group and its number. */
  let answered = "";
  let under: { readonly gathering: number; readonly landing: number } | null = null;

  function goThere(): void {
    const gathering = store.get().group?.gathering;
    if (!gathering) return;
    under = { gathering: gathering.number, landing: land(gathering.position, gathering.radiusM) };
    told(store.get());
  }

  /** Tell the group once the landing that it asked for is over. */
  function told({ landing }: ViewerState): void {
    if (under === null || landing === null) return;
    const isOther = landing.landing !== under.landing;
    const isReady = landing.phase === "shown" && landing.readyMs !== null;
    if (!isOther && !isReady && landing.phase !== "refused") return;
    const state = isOther || landing.phase === "refused" ? "declined" : "ready";
    stream.group({ type: "arrive", gathering: under.gathering, state });
    under = null;
  }

  function answer(): void {
    const { group, follows } = store.get();
    const gathering = group?.gathering;
    if (!group || !gathering) return;
    const key = `${group.name} ${group.member} ${gathering.number}`;
    if (key === answered) return;
    answered = key;
    if (gathering.guide === group.member) {
      // He brings the others to where he is.
      stream.group({ type: "arrive", gathering: gathering.number, state: "ready" });
    } else if (follows) {
      const guide = group.members.find(({ member }) => member === gathering.guide)?.name ?? "The guide";
      announcer.announce(`${guide} takes the group along`);
      goThere();
    } else {
      stream.group({ type: "arrive", gathering: gathering.number, state: "declined" });
    }
  }

  const stop = store.subscribe(told);
  return {
    handle(event) {
      if (event.type !== "group") return;
      store.set({ group: event.group, groupProblem: event.refusal?.message ?? null });
      answer();
    },
    join(group, role, name) {
      store.set({ groupProblem: null });
      try {
        stream.group({ type: "join", group, role, name: name === "" ? null : name });
      } catch (error) {
        store.set({ groupProblem: error instanceof Error ? error.message : String(error) });
      }
    },
    leave: () => stream.group({ type: "leave" }),
    gather() {
      const { landed } = store.get();
      if (landed !== null) stream.group({ type: "gather", position: landed.place, radiusM: landed.radiusM });
    },
    goThere,
    goTo: (position) => void land(position, store.get().radiusM),
    dispose: stop,
  };
}
