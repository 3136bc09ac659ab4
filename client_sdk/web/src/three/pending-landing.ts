/** The promise of one landing: settled when it is shown, refused or superseded, or when the connection is gone. */

import { StreamError } from "../core/scene/errors.ts";
import type { LinkState } from "../core/types.ts";
import type { LandingStatus } from "./types.ts";

/** A connection may be down for this long before the promise is rejected. */
const PATIENCE_MS = 15_000;

/** Call `followLink` with each state of the link, and one of `resolve` and `reject` once. */
export class PendingLanding {
  readonly promise: Promise<LandingStatus>;
  readonly #resolve: (status: LandingStatus) => void;
  readonly #reject: (error: StreamError) => void;
  #timer: ReturnType<typeof setTimeout> | null = null;

  constructor() {
    let [resolve, reject] = [(_: LandingStatus) => {}, (_: StreamError) => {}];
    this.promise = new Promise((...settle) => {
      [resolve, reject] = settle;
    });
    // Errors are also reported by events: a caller that does not wait is not to see "unhandled rejection".
    this.promise.catch(() => undefined);
    this.#resolve = resolve;
    this.#reject = reject;
  }

  resolve(status: LandingStatus): void {
    this.#stopTimer();
    this.#resolve(status);
  }

  reject(code: string, message: string): void {
    this.#stopTimer();
    this.#reject(new StreamError(code, message));
  }

  /** Reject at once where the link is closed for good, and after a while where it is down. */
  followLink(link: LinkState | null): void {
    if (link === null || link.state === "open") this.#stopTimer();
    else if (link.state === "closed") this.reject(link.code, link.message);
    else {
      this.#timer ??= setTimeout(() => {
        this.reject("unreachable", `no connection for ${PATIENCE_MS / 1000} s; the landing is shown once there is one`);
      }, PATIENCE_MS);
    }
  }

  #stopTimer(): void {
    if (this.#timer !== null) clearTimeout(this.#timer);
    this.#timer = null;
  }
}
