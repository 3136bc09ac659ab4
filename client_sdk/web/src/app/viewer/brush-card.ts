/** The card of the brush: what is painted next, who painted, and what the strokes have taught. */

import type { PaintedStroke, TaughtGround } from "../../core/types.ts";
import { regionColour, toCss } from "../../three/palette.ts";
import { fill, h, setAttribute, setShown, setText } from "../dom.ts";
import { formatArea, formatPercent } from "../format.ts";
import { icon } from "../icons.ts";

/** What the buttons do. */
export interface BrushCardOptions {
  undo(): void;
  /** The user shows or hides what was taught. */
  shown(): void;
  /** Look at the place number so and so where a stroke pays. */
  nextPlace(index: number): void;
}

/** What the card shows. */
export interface BrushCardState {
  readonly strokes: readonly PaintedStroke[];
  readonly taught: TaughtGround | null;
  /** Whether an answer is due. */
  readonly waits: "no" | "yes" | "long";
}

/** The card, and the brush that is set in it. */
export interface BrushCard {
  readonly element: HTMLElement;
  readonly brush: { readonly name: string; readonly colour: string; readonly widthM: number };
  readonly showsTaught: boolean;
  /** Whether there is a name to paint; where not, the field is shown to lack one. */
  isNamed(): boolean;
  show(state: BrushCardState): void;
  setFault(text: string | null): void;
}

/** A name may be as long as a label. */
const MAX_NAME_LENGTH = 256;
const MIN_WIDTH_M = 0.05;
const MAX_WIDTH_M = 100;
const FIRST_WIDTH_M = 3;

/** Build it. */
export function createBrushCard(options: BrushCardOptions): BrushCard {
  let knownNames = new Map<string, string>();
  let placeIndex = 0;

  const names = h("datalist", { id: "brush-names" });
  const name = h("input", {
    id: "brush-name",
    type: "text",
    list: "brush-names",
    maxlength: MAX_NAME_LENGTH,
    placeholder: "haul road",
    autocomplete: "off",
    on: {
      input() {
        setAttribute(name, "aria-invalid", null);
        const known = knownNames.get(name.value.trim());
        if (known !== undefined) colour.value = known;
      },
      change() {
        // A name that is new gets a colour that no other has.
        if (!knownNames.has(name.value.trim())) colour.value = toCss(regionColour(knownNames.size));
      },
    },
  });
  const colour = h("input", { id: "brush-colour", type: "color", value: toCss(regionColour(0)), title: "Colour" });
  const width = h("input", {
    id: "brush-width",
    type: "number",
    min: MIN_WIDTH_M,
    max: MAX_WIDTH_M,
    step: "any",
    value: FIRST_WIDTH_M,
  });
  const undo = h(
    "button",
    {
      type: "button",
      class: "icon-button",
      "data-action": "brush-undo",
      "aria-label": "Take back my last stroke",
      title: "Take back my last stroke (Backspace)",
      on: { click: options.undo },
    },
    icon("undo"),
  );
  const shows = h("input", { id: "brush-shows", type: "checkbox", checked: true, on: { change: options.shown } });
  const count = h("p", { class: "faint", id: "brush-count" });
  const status = h("p", { id: "brush-status", role: "status" });
  const fault = h("p", { id: "brush-fault", class: "brush-fault", role: "alert", hidden: true });
  const legend = h("ul", { id: "brush-legend", class: "brush-legend", "aria-label": "Names that were taught" });
  const next = h(
    "button",
    {
      type: "button",
      class: "button",
      "data-action": "brush-next",
      hidden: true,
      on: {
        click() {
          options.nextPlace(placeIndex);
          placeIndex += 1;
        },
      },
    },
    "Where it is unsure",
  );
  const element = h(
    "section",
    { id: "brush-card", class: "brush-card", "aria-label": "Teach names with a brush", hidden: true },
    h(
      "div",
      { class: "row" },
      h("label", { for: "brush-name", class: "visually-hidden" }, "Name"),
      name,
      names,
      h("label", { for: "brush-colour", class: "visually-hidden" }, "Colour"),
      colour,
      undo,
    ),
    h("div", { class: "row" }, h("label", { for: "brush-width" }, "Width, metres"), width),
    status,
    fault,
    legend,
    h("div", { class: "row" }, h("label", { class: "check" }, shows, "Show what it learned"), next),
    count,
  );

  return {
    element,
    get brush() {
      const metres = Number(width.value);
      const widthM = Number.isFinite(metres) ? Math.min(MAX_WIDTH_M, Math.max(MIN_WIDTH_M, metres)) : FIRST_WIDTH_M;
      return { name: name.value.trim(), colour: colour.value, widthM };
    },
    get showsTaught() {
      return shows.checked;
    },
    isNamed() {
      const isNamed = name.value.trim() !== "";
      setAttribute(name, "aria-invalid", isNamed ? null : "true");
      if (!isNamed) {
        setText(status, "Give the ground a name first.");
        name.focus();
      }
      return isNamed;
    },
    show({ strokes, taught, waits }) {
      knownNames = new Map(strokes.map((stroke) => [stroke.name, stroke.colour]));
      fill(names, ...[...knownNames.keys()].map((known) => h("option", { value: known })));
      const own = strokes.filter(({ isOwn }) => isOwn).length;
      const people = new Set(strokes.map(({ who }) => who)).size;
      const byWhom = people > 1 ? ` by ${people} people` : "";
      setText(count, strokes.length === 0 ? "" : `${strokes.length} strokes${byWhom}, ${own} of them yours.`);
      undo.disabled = own === 0;
      setText(status, statusText(strokes.length, taught, waits));
      setAttribute(element, "data-waits", waits);
      const picture = taught?.picture ?? null;
      fill(
        legend,
        ...(picture?.names ?? []).map((row) => {
          const swatch = h("span", { class: "brush-swatch", "aria-hidden": "true" });
          swatch.style.background = row.colour;
          const facts = `${formatArea(row.areaM2)}, ${formatPercent(row.confidence)} sure`;
          return h("li", {}, swatch, h("span", {}, row.name), h("span", { class: "faint" }, facts));
        }),
      );
      setShown(next, (picture?.places.length ?? 0) > 0);
    },
    setFault(text) {
      setShown(fault, text !== null);
      setText(fault, text ?? "");
    },
  };
}

function statusText(count: number, taught: TaughtGround | null, waits: BrushCardState["waits"]): string {
  if (count === 0) return "Paint three short strokes on each kind of ground. What is around it needs a name, too.";
  if (waits === "long") {
    return "Nobody answers. The strokes are kept; terraport teach SCENES --watch, beside the service, learns from them.";
  }
  if (waits === "yes") return "Learning…";
  if (taught === null) return "";
  if (taught.state === "refused") return `Nothing learned yet: ${taught.text}.`;
  return taught.state === "published" ? "Learned and published." : "Learned. Striped ground is unsure: paint there.";
}
