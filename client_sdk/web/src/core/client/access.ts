/** Tokens of a session that may outlive them. */

import type { Token } from "../types.ts";

/** The token of each connection, and whether another attempt is worth while. */
export class Access {
  #token: Token | undefined;
  #shown: string | undefined;

  constructor(token: Token | undefined) {
    this.#token = token;
  }

  /** The present token: at once where it is fixed, else a promise. */
  show(): string | undefined | Promise<string> {
    const token = this.#token;
    if (typeof token !== "function") {
      this.#shown = token;
      return token;
    }
    return this.#asked(token).then((present) => {
      // Another one was given by hand meanwhile: what that replaced was not shown.
      if (this.#token === token) this.#shown = present;
      return present;
    });
  }

  /** Whether there may be another token than the one shown last, which was refused. */
  get isRenewed(): boolean {
    return typeof this.#token === "function";
  }

  /** Whether there is another token than the one shown last. */
  async hasNewer(): Promise<boolean> {
    const token = this.#token;
    return typeof token === "function" && (await this.#asked(token)) !== this.#shown;
  }

  /** Show this token from now on, asking nobody; whether it is another one. */
  replace(token: string | undefined): boolean {
    if (token === undefined || token === this.#shown) return false;
    this.#token = token;
    return true;
  }

  /** What it throws is a rejection like any other. */
  async #asked(token: () => string | Promise<string>): Promise<string> {
    return token();
  }
}
