/** Messages on their way out, no faster than the server allows. */

import { Pacer } from "../session/pacing.ts";

type Data = Uint8Array<ArrayBuffer>;

/** Before the welcome says what is allowed: hello, and nothing else. */
const GREETING_PER_S = 1;

/** Sends in order; what the server's message rate does not allow yet waits. */
export class Outgoing {
  readonly #send: (data: Data) => void;
  readonly #drained: () => void;
  #pacer = new Pacer(GREETING_PER_S, performance.now());
  #waiting: Data[] = [];
  #timer: ReturnType<typeof setTimeout> | undefined;

  /** `drained` is called when the last of what had to wait has gone. */
  constructor(send: (data: Data) => void, drained: () => void) {
    this.#send = send;
    this.#drained = drained;
  }

  /** Whether something waits; the owner then gives no more until `drained`. */
  get blocked(): boolean {
    return this.#waiting.length > 0;
  }

  /** Take what the server says it allows. */
  allow(messagesPerS: number): void {
    this.#pacer = new Pacer(messagesPerS, performance.now());
  }

  /** Send these behind what waits. */
  push(messages: readonly Data[]): void {
    this.#waiting.push(...messages);
    if (this.#timer === undefined) this.#proceed();
  }

  /** Forget what waits: the connection is gone. */
  clear(): void {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    this.#waiting = [];
    this.#pacer = new Pacer(GREETING_PER_S, performance.now());
  }

  #proceed(): void {
    for (let data = this.#waiting[0]; data !== undefined; data = this.#waiting[0]) {
      const pauseMs = this.#pacer.take(performance.now());
      if (pauseMs > 0) {
        this.#timer = setTimeout(() => this.#continue(), pauseMs);
        return;
      }
      this.#waiting.shift();
      this.#send(data);
    }
  }

  /** Send the one that was waited for, which is booked already, and go on. */
  #continue(): void {
    this.#timer = undefined;
    const data = this.#waiting.shift();
    if (data !== undefined) this.#send(data);
    this.#proceed();
    if (!this.blocked) this.#drained();
  }
}
