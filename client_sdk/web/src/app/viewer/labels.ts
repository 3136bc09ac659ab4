/** Pins and words that stand at places of the scene, drawn by the page above the canvas: always upright and sharp. */

import type { Vec3 } from "../../core/types.ts";
import { h } from "../dom.ts";

/** Something that stands at a place. */
export interface Label {
  readonly position: Vec3;
  readonly kind: "aim" | "pick" | "measure" | "length";
  /** Empty for a pin. */
  readonly text: string;
}

/** Texts at points of the scene, moved with the camera. */
export interface Labels {
  readonly element: HTMLElement;
  set(labels: readonly Label[]): void;
  /** After the camera moved: put each where its place is now. */
  update(pixelOf: (position: Vec3) => { readonly x: number; readonly y: number } | null): void;
  /** Draw the visible labels into a picture of the canvas, in the page's style; `scale`: its pixels per CSS pixel. */
  paint(context: CanvasRenderingContext2D, scale: number): void;
}

/** Make the layer. What it shows also stands in the panel: it is hidden from assistive technology. */
export function createLabels(): Labels {
  const element = h("div", { class: "labels", "aria-hidden": "true" });
  let entries: { readonly label: Label; readonly element: HTMLElement }[] = [];
  return {
    element,
    set(labels) {
      entries = labels.map((label) => ({
        label,
        element: h("span", { class: "label", "data-kind": label.kind }, label.text),
      }));
      element.replaceChildren(...entries.map((entry) => entry.element));
    },
    update(pixelOf) {
      for (const { label, element: span } of entries) {
        const pixel = pixelOf(label.position);
        span.hidden = pixel === null;
        if (pixel !== null) span.style.transform = `translate(${pixel.x.toFixed(1)}px, ${pixel.y.toFixed(1)}px)`;
      }
    },
    paint(context, scale) {
      const corner = element.getBoundingClientRect();
      context.save();
      context.scale(scale, scale);
      context.textAlign = "center";
      context.textBaseline = "middle";
      for (const { element: span } of entries) {
        const { left, top, width, height } = span.getBoundingClientRect();
        if (width === 0) continue; // Hidden.
        const style = getComputedStyle(span);
        const border = Number.parseFloat(style.borderTopWidth);
        const [x, y, radius] = [left - corner.left, top - corner.top, Number.parseFloat(style.borderTopLeftRadius)];
        context.beginPath();
        // A radius of 50 % is a circle.
        const isRound = style.borderTopLeftRadius.endsWith("%");
        const inset = border / 2;
        context.roundRect(x + inset, y + inset, width - border, height - border, isRound ? width / 2 - inset : radius);
        context.fillStyle = style.backgroundColor;
        context.fill();
        if (border > 0) {
          context.strokeStyle = style.borderTopColor;
          context.lineWidth = border;
          context.stroke();
        }
        context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
        context.fillStyle = style.color;
        context.fillText(span.textContent, x + width / 2, y + height / 2);
      }
      context.restore();
    },
  };
}
