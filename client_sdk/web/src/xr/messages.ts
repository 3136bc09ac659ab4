/** What the stream's events say to somebody in the headset; null where they say nothing. */

import type { StreamEvent } from "../core/types.ts";
import type { LandingStatus } from "../three/types.ts";
import type { Tone } from "./types.ts";

export interface Message {
  readonly text: string;
  readonly tone: Tone;
  /** Until the next message; else for a few seconds. */
  readonly stays: boolean;
}

/** What the board has announced: the return of the link is news only after its loss was. */
export interface Announced {
  linkLost: boolean;
}

/** The board's words for an event; null for one that needs none. Changes `announced`. */
export function messageOf(event: StreamEvent, announced: Announced): Message | null {
  if (event.type === "link") {
    return linkMessage(event.link, announced);
  }
  if (event.type === "degraded") {
    return {
      text: "The link is slow: only the nearest ground is sharp. The rest follows.",
      tone: "warning",
      stays: false,
    };
  }
  if (event.type === "refused") {
    // A refused landing is told where the landing is known.
    return event.landing === null ? { text: sentence(event.message), tone: "warning", stays: event.fatal } : null;
  }
  return null;
}

function linkMessage(link: Extract<StreamEvent, { type: "link" }>["link"], announced: Announced): Message | null {
  if (link.state === "waiting") {
    if (announced.linkLost) {
      return null;
    }
    announced.linkLost = true;
    return {
      text: "The link is lost. The ground you see stays; trying to reconnect.",
      tone: "warning",
      stays: true,
    };
  }
  if (link.state === "closed") {
    announced.linkLost = true;
    return { text: `The link is closed: ${sentence(link.message)}`, tone: "warning", stays: true };
  }
  if (link.state === "open" && announced.linkLost) {
    announced.linkLost = false;
    return { text: "The link is back.", tone: "info", stays: false };
  }
  return null;
}

/** One line on the newest landing, for the menu. */
export function statusLine(status: LandingStatus, linkLost: boolean): string {
  const link = linkLost ? "No link. " : "";
  const loaded = `${Math.floor(status.fraction * 100)} %`;
  switch (status.phase) {
    case "idle":
      return `${link}No landing yet.`;
    case "planning":
      return `${link}Asking for the ground there.`;
    case "streaming":
      return `${link}Loading the ground: ${loaded}.`;
    case "degraded-presentable":
      return `${link}The nearest ground is there; loading the rest: ${loaded}.`;
    case "refused":
      return `${link}Landing refused.`;
    default: {
      const missing = status.missing.length === 0 ? "" : `, ${status.missing.length} segments missing`;
      return `${link}Landed, ${Math.round(status.radiusM)} m around${missing}.`;
    }
  }
}

/** The service writes its messages lower-case without a full stop. */
export function sentence(message: string): string {
  const text = message.trim();
  if (text === "") {
    return "The service gave no reason.";
  }
  const full = /[.!?]$/.test(text) ? text : `${text}.`;
  return full[0]!.toUpperCase() + full.slice(1);
}

/** Break a text into lines that fit, by the width that `measure` gives; words longer than a line stand alone. */
export function wrapText(text: string, maxWidth: number, measure: (line: string) => number): string[] {
  const lines: string[] = [];
  let line = "";
  for (const word of text.split(/\s+/)) {
    const longer = line === "" ? word : `${line} ${word}`;
    if (line !== "" && measure(longer) > maxWidth) {
      lines.push(line);
      line = word;
    } else {
      line = longer;
    }
  }
  if (line !== "") {
    lines.push(line);
  }
  return lines;
}
