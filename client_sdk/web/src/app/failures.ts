/** What went wrong, in two sentences: what happened, and what can be done. PURE. */

import type { LinkState } from "../core/types.ts";
import { MAX_BESIDE_M } from "../three/footing.ts";
import { formatRadius } from "./format.ts";

/** What the user can do about it; the page knows how. */
export type Remedy = "reconnect" | "token" | "scenes" | "reload-page" | "reload-scene" | "smaller-radius" | "dismiss";

/** A message of the page. One of a `key` replaces another. */
export interface Notice {
  readonly key: string;
  /** `failure` is read out at once, the others when there is time. */
  readonly tone: "info" | "warning" | "failure";
  readonly title: string;
  readonly text: string;
  readonly remedies: readonly Remedy[];
  /** Counts down to this time (ms of `performance.now()`), `{seconds}` in the text. */
  readonly untilMs?: number;
}

/** Names of the buttons. */
export const REMEDY_NAMES: Readonly<Record<Remedy, string>> = {
  reconnect: "Reconnect now",
  token: "Enter a token",
  scenes: "All scenes",
  "reload-page": "Reload the page",
  "reload-scene": "Load the new version",
  "smaller-radius": "Use the largest radius",
  dismiss: "Dismiss",
};

/** What a link's state means; null where there is nothing to say. `wasOpen`: whether there has been a link before. */
export function linkNotice(link: LinkState, wasOpen: boolean, nowMs: number): Notice | null {
  if (link.state === "open") return null;
  // The first attempt is the page's loading, which says so itself.
  if (link.state === "connecting") {
    if (!wasOpen && link.attempt <= 1) return null;
    return {
      key: "link",
      tone: "warning",
      title: "Reconnecting",
      text: "What is shown stays. New landings wait for the connection.",
      remedies: [],
    };
  }
  if (link.state === "waiting") {
    const untilMs = nowMs + link.retryInMs;
    if (link.code === "too_many") {
      return {
        key: "link",
        tone: "warning",
        title: "The server is full",
        text: `It takes no more visitors just now. Trying again in {seconds}; what is shown stays.`,
        remedies: ["reconnect"],
        untilMs,
      };
    }
    if (link.code === "draining") {
      return {
        key: "link",
        tone: "info",
        title: "The server restarts",
        text: "Reconnecting in {seconds}. What is shown stays, and nothing is loaded twice.",
        remedies: ["reconnect"],
        untilMs,
      };
    }
    return {
      key: "link",
      tone: "warning",
      title: wasOpen ? "Connection lost" : "No connection",
      text: wasOpen
        ? "What is shown stays. Reconnecting in {seconds}."
        : "The service does not answer. Trying again in {seconds}.",
      remedies: ["reconnect"],
      untilMs,
    };
  }
  return closedNotice(link.code, link.message);
}

/** For good: nothing is tried again, so every text ends in what the user can do. */
function closedNotice(code: string, message: string): Notice {
  const failure = (title: string, text: string, remedies: readonly Remedy[]): Notice => ({
    key: "link",
    tone: "failure",
    title,
    text,
    remedies,
  });
  switch (code) {
    case "unauthorised":
      return failure(
        "The token is not accepted",
        "It is wrong, has expired, or was withdrawn. What is shown stays; with another token you can go on.",
        ["token"],
      );
    case "forbidden":
      return failure(
        "This scene is not open to you",
        "Your token is valid, but not for this scene. Ask the service's operator for access.",
        ["token", "scenes"],
      );
    case "unknown_scene":
      return failure(
        "The scene is gone",
        "The service no longer has it. What is shown stays until you leave; nothing more can be loaded.",
        ["scenes"],
      );
    case "unsupported_version":
    case "unsupported_encoding":
      return failure(
        "Page and service do not match",
        "The service was probably updated while the page was open. Reload it to get the page that belongs to it.",
        ["reload-page"],
      );
    default:
      return failure("The connection has ended", sentence(message) || "The service ended it for good.", [
        "reconnect",
        "scenes",
      ]);
  }
}

/** A click beside the ground. */
export function nothingNotice(): Notice {
  return {
    key: "ground",
    tone: "info",
    title: "There is no ground there",
    text: "The survey has nothing where you clicked. Click the ground itself; Home shows all of it.",
    remedies: ["dismiss"],
  };
}

/** A place in a wall, or where there is no room: refused to a walker, shown from above to others. */
export function steepNotice(isWalking: boolean): Notice {
  return {
    key: "ground",
    tone: "info",
    title: "Nobody could stand there",
    text: `It is too steep, or too low, and so is everything within ${MAX_BESIDE_M} m of it. ${
      isWalking
        ? "Choose flatter ground, or look at it from above."
        : "You see it from above; click flatter ground to go there."
    }`,
    remedies: ["dismiss"],
  };
}

/** A landing, or a link, where nothing of the scene can be. */
export function outsideNotice(outsideM: number, radiusM: number): Notice {
  return {
    key: "landing",
    tone: "warning",
    title: "That place lies outside the scene",
    text: `It is ${formatRadius(outsideM)} away from it, more than the radius of ${formatRadius(radiusM)}: there is nothing to show. Choose a place on the ground.`,
    remedies: ["dismiss"],
  };
}

/** What a refused landing means. Only landings of the user: a refused aim says nothing. */
export function refusalNotice(code: string, message: string, maxRadiusM: number | null): Notice {
  if (code === "radius_too_large") {
    return {
      key: "landing",
      tone: "warning",
      title: "The radius is too large",
      text: `This service lands within ${maxRadiusM === null ? "a smaller radius" : `${maxRadiusM} m`} at most. What is shown stays.`,
      remedies: maxRadiusM === null ? ["dismiss"] : ["smaller-radius", "dismiss"],
    };
  }
  return {
    key: "landing",
    tone: "warning",
    title: "No landing there",
    text: sentence(message) || "The service refused the place. What is shown stays.",
    remedies: ["dismiss"],
  };
}

/** Why a scene or the list could not be loaded. `code` is an error code of the service, or of `StreamError`. */
export function loadFailure(code: string, message: string): { readonly title: string; readonly text: string } {
  switch (code) {
    case "unauthorised":
      return { title: "A token is needed", text: "This service shows its scenes to whoever has a token." };
    case "forbidden":
      return {
        title: "This scene is not open to you",
        text: "Your token is valid, but not for this scene. Ask the service's operator for access.",
      };
    case "unknown_scene":
      return {
        title: "There is no such scene",
        text: "It was renamed or withdrawn, or the link is wrong. The list shows what the service has.",
      };
    case "too_many":
      return { title: "The server is full", text: "It takes no more visitors just now. Try again in a moment." };
    case "draining":
      return { title: "The server restarts", text: "Try again in a moment." };
    default:
      return {
        title: "It could not be loaded",
        text: `${sentence(message) || "The service did not answer."} Check the connection and try again.`,
      };
  }
}

/** Messages of the service are lower-case and have no full stop. */
function sentence(message: string): string {
  const text = message.trim();
  if (!text) return "";
  return `${text[0]!.toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;
}
