/** "Together": join a group or guide one, who is in it, and where they are. */

import type { Gathering, GroupFacts, GroupMember, GroupRole } from "../../core/extras/group-types.ts";
import type { Vec3 } from "../../core/types.ts";
import { fill, h, setShown, setText } from "../dom.ts";
import { formatRadius } from "../format.ts";
import { icon } from "../icons.ts";
import { measureLeg } from "../measure.ts";
import type { ViewerState, ViewerStore } from "../viewer/state.ts";

/** What its buttons do. */
export interface GroupActions {
  join(group: string, role: GroupRole, name: string): void;
  leave(): void;
  gather(): void;
  goThere(): void;
  /** Go where somebody stands. */
  goTo(position: Vec3): void;
}

/** Of a group's name, as the wire has it. */
const NAME_PATTERN = "[A-Za-z0-9_.~\\-]+";
const MAX_NAME_LENGTH = 64;

/** Of the compass, from the north by the east. */
const WINDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];
/** Who is nearer than this stands beside one. */
const BESIDE_M = 1;

/** Where somebody is, as far as the group knows. */
export function whereText({ member, isPresent }: GroupMember, gathering: Gathering | null): string {
  if (!isPresent) return "connection lost";
  if (gathering === null) return "here";
  if (gathering.guide === member) return "leads";
  if (!gathering.isOver) return "is asked to come";
  if (gathering.ready.includes(member)) return "came along";
  return gathering.degraded.includes(member) ? "came along, still loading" : "elsewhere";
}

/** How far somebody stands from one, seen from above, and which way: `12 m north`. */
export function awayText(from: Vec3, to: Vec3): string {
  const { horizontalM, azimuthDeg } = measureLeg(from, to);
  if (horizontalM < BESIDE_M || azimuthDeg === null) return "beside you";
  return `${formatRadius(horizontalM)} ${WINDS[Math.round(azimuthDeg / 45) % WINDS.length]}`;
}

function nameOf({ member, name }: GroupMember, own: number): string {
  const text = name ?? `Guest ${member}`;
  return member === own ? `${text} (you)` : text;
}

/** Build it; it follows the store. */
export function createGroupSection(store: ViewerStore, actions: GroupActions): HTMLElement {
  const group = h("input", {
    id: "group-name",
    type: "text",
    required: true,
    pattern: NAME_PATTERN,
    maxlength: MAX_NAME_LENGTH,
    placeholder: "tour-1",
    title: "Letters, digits, - _ . ~",
  });
  const name = h("input", { id: "group-own-name", type: "text", maxlength: MAX_NAME_LENGTH, placeholder: "Anna" });
  const form = h(
    "form",
    {
      id: "group-form",
      class: "keep-form",
      on: {
        submit: (event) => {
          event.preventDefault();
          const { submitter } = event as SubmitEvent;
          const role = submitter?.dataset.role === "guide" ? "guide" : "member";
          actions.join(group.value, role, name.value.trim());
        },
      },
    },
    h(
      "p",
      { class: "hint" },
      "Look at the scene together: who joins under the same name is in one group, and sees where the others land. The guide brings everybody to where he is.",
    ),
    h("label", { for: "group-name" }, "Group"),
    group,
    h("label", { for: "group-own-name" }, "Your name, as the others see it"),
    name,
    h(
      "div",
      { class: "row" },
      h("button", { type: "submit", class: "button primary", "data-role": "member" }, "Join"),
      h("button", { type: "submit", class: "button", "data-role": "guide" }, "Guide"),
    ),
  );
  const problem = h("p", { id: "group-problem", role: "alert" });
  const title = h("p", { id: "group-title" });
  let rows = new Map<string, MemberRow>();
  const list = h("ul", { id: "group-members", class: "places", "aria-label": "Who is in the group" });
  const follows = h("input", {
    id: "group-follows",
    type: "checkbox",
    on: { change: () => store.set({ follows: follows.checked }) },
  });
  const followRow = h("label", { class: "choice", for: "group-follows" }, follows, "Follow the guide");
  const gather = button("Bring everybody here", "group-gather", actions.gather);
  const goThere = button("Go to the guide", "group-go", actions.goThere);
  const joined = h(
    "div",
    { class: "group" },
    title,
    list,
    followRow,
    h("div", { class: "row" }, gather, goThere, button("Leave", "group-leave", actions.leave)),
  );

  function show({ group: facts, groupProblem, follows: isFollowing, landed }: ViewerState): void {
    setShown(form, facts === null);
    setShown(joined, facts !== null);
    setText(problem, groupProblem ?? "");
    setShown(problem, groupProblem !== null);
    if (facts === null) return;
    showGroup(facts, landed?.place ?? null);
    const isGuide = facts.role === "guide";
    follows.checked = isFollowing;
    setShown(followRow, !isGuide);
    setShown(gather, isGuide);
    gather.disabled = landed === null;
    setShown(goThere, !isGuide && facts.gathering !== null);
  }

  function showGroup({ name: groupName, member, members, gathering }: GroupFacts, own: Vec3 | null): void {
    setText(title, `${groupName}: ${members.length} ${members.length === 1 ? "person" : "people"}`);
    // Rows stay as long as their people do: a list comes every second, and a click takes longer than an instant.
    const shown = members.map((one) => {
      const { position } = one;
      const isElsewhere = one.member !== member && position !== null;
      const key = `${one.member} ${isElsewhere}`;
      const row = rows.get(key) ?? memberRow(one.member, isElsewhere, actions.goTo);
      const where = whereText(one, gathering);
      setText(row.name, `${nameOf(one, member)}${one.role === "guide" ? ", guide" : ""}`);
      setText(row.where, isElsewhere && own !== null ? `${where} · ${awayText(own, position)}` : where);
      row.position = position;
      return [key, row] as const;
    });
    const isSame = shown.length === rows.size && shown.every(([key]) => rows.has(key));
    if (isSame) return;
    rows = new Map(shown);
    fill(list, ...shown.map(([, { element }]) => element));
  }

  store.subscribe((state, before) => {
    const isSame =
      state.group === before.group &&
      state.groupProblem === before.groupProblem &&
      state.follows === before.follows &&
      state.landed === before.landed;
    if (!isSame) show(state);
  });
  show(store.get());
  return h("section", { "aria-label": "Together" }, h("h2", {}, "Together"), form, problem, joined);
}

/** Somebody in the list. */
interface MemberRow {
  readonly element: HTMLElement;
  readonly name: HTMLElement;
  readonly where: HTMLElement;
  position: Vec3 | null;
}

/** A row; one of somebody who stands elsewhere takes one there. */
function memberRow(member: number, isElsewhere: boolean, goTo: (position: Vec3) => void): MemberRow {
  const name = h("span", { class: "region-name" });
  const where = h("span", { class: "faint" });
  const click = (): void => {
    if (row.position !== null) goTo(row.position);
  };
  const content = isElsewhere
    ? [
        h(
          "button",
          { type: "button", class: "place-go", "data-action": "go-to-member", on: { click } },
          icon("go"),
          name,
          where,
        ),
      ]
    : [name, where];
  const row: MemberRow = { element: h("li", { "data-member": member }, ...content), name, where, position: null };
  return row;
}

function button(text: string, action: string, act: () => void): HTMLButtonElement {
  return h("button", { type: "button", class: "button", "data-action": action, on: { click: act } }, text);
}
