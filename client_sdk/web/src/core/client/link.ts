/**
 * The connection of a session: opened, lost, opened again.
 *
 * The state is the session's; here are the socket and the timers. Section numbers are those of `spec/protocol.md`.
 */

import { waitMs } from "../session/backoff.ts";
import type { SessionEvent } from "../session/events.ts";
import { type ClientSession, ProtocolViolation } from "../session/session.ts";
import type { LinkState, Token } from "../types.ts";
import { afterClose, CLOSE_CODES, codeOfClose } from "../wire/errors.ts";
import { encodeMessage, SUBPROTOCOL, tokenSubprotocol } from "../wire/messages.ts";
import { Access } from "./access.ts";
import { Outgoing } from "./outgoing.ts";

/** Between two aims: a hand moves faster, but ten plans a second are enough to prefetch by. */
const AIM_PERIOD_MS = 100;

/** One attempt: TCP, TLS, WebSocket handshake and welcome. */
const CONNECT_MS = 10_000;

/** After a connection that lived this long, or completed a landing, the waits begin at the shortest again. */
const STABLE_MS = 10_000;

/**
 * Silence of a server that owes an answer. A page cannot send pings, and without them a dead line is noticed by TCP
 * after minutes only.
 */
const SILENCE_MS = 30_000;

const ABNORMAL = 1006;
const NORMAL = 1000;

/** What {@link Link} works with. */
export interface LinkOptions {
  readonly session: ClientSession;
  /** `ws(s)://.../stream`. */
  readonly url: string;
  readonly token: Token | undefined;
  readonly WebSocket: typeof WebSocket;
  /** Takes the session's events, in order. */
  readonly handle: (events: readonly SessionEvent[]) => void;
  readonly onLinkState: (link: LinkState) => void;
}

/** Carries what a session sends and receives. */
export interface Connection {
  /** Connect for the first time. */
  start(): void;
  /** Hand out events and send what the session has to send; to be called after every command. */
  pump(): void;
  /** Connect now, unless there is a connection already; another token makes a new one in any case. */
  reconnect(token: string | undefined): void;
  /** Connect to that address from now on. */
  moveTo(url: string): void;
  /** End a connection on which the server broke the protocol. */
  refuse(reason: string): void;
  /** Do not connect again. */
  leave(): void;
}

/** Keeps one session connected until {@link leave}. */
export class Link implements Connection {
  readonly #options: LinkOptions;
  #url: string;
  readonly #outgoing: Outgoing;
  readonly #access: Access;
  #socket: WebSocket | null = null;
  /** Number of the token request under way; null where there is none. */
  #question: number | null = null;
  #questions = 0;
  #attempt = 0;
  #begun = false;
  #hasLeft = false;
  /** The error that the server gave before the close which follows. */
  #refusal: { readonly code: string; readonly message: string } | null = null;
  #firstWaitMs: number | null = null;
  #welcomedMs: number | null = null;
  /** By any connection: a service that never knew the token needs no second attempt with another. */
  #wasWelcomed = false;
  #receivedMs = 0;
  #owedSinceMs: number | null = null;
  #nextAimMs = 0;
  #retryTimer: ReturnType<typeof setTimeout> | undefined;
  #welcomeTimer: ReturnType<typeof setTimeout> | undefined;
  #aimTimer: ReturnType<typeof setTimeout> | undefined;
  #watch: ReturnType<typeof setInterval> | undefined;

  constructor(options: LinkOptions) {
    this.#options = options;
    this.#url = options.url;
    this.#access = new Access(options.token);
    this.#outgoing = new Outgoing(
      (data) => this.#socket?.send(data),
      () => this.pump(),
    );
  }

  /** Connect for the first time. */
  start(): void {
    if (this.#hasLeft || this.#begun) return;
    this.#begun = true;
    this.#connect();
  }

  /** Hand out events and send what the session has to send; to be called after every command. */
  pump(): void {
    const { session } = this.#options;
    // Events first: what their listeners ask for goes out with the rest.
    this.#report();
    // While the server's message rate holds messages back, aims wait in the session, where a newer one replaces an older.
    if (!this.#outgoing.blocked) {
      if (session.hasAim) this.#aim();
      this.#outgoing.push(session.messagesToSend().map(encodeMessage));
    }
    if (!session.awaitsAnswer) this.#owedSinceMs = null;
    else this.#owedSinceMs ??= performance.now();
  }

  /** Connect now, unless there is a connection already; another token makes a new one in any case. */
  reconnect(token: string | undefined): void {
    if (this.#hasLeft) return;
    const newer = this.#access.replace(token);
    if (!this.#begun || (this.#isConnecting && !newer)) return;
    this.#drop(NORMAL);
    this.#attempt = 0;
    this.#firstWaitMs = null;
    this.#connect();
  }

  /** Connect to that address from now on, and now, unless it was closed for good. */
  moveTo(url: string): void {
    this.#url = url;
    const wasConnecting = this.#isConnecting;
    this.pump();
    if (this.#hasLeft || !wasConnecting) return;
    this.#drop(NORMAL);
    this.#report();
    this.#attempt = 0;
    this.#connect();
  }

  /** Close a connection on which the server broke the protocol. */
  refuse(reason: string): void {
    this.#refusal = { code: "malformed", message: `the server broke the protocol: ${reason}` };
    this.#cut(CLOSE_CODES.malformed, "malformed");
  }

  /** Send `bye` and do not connect again. */
  leave(): void {
    if (this.#hasLeft) return;
    this.#hasLeft = true;
    this.#options.session.bye();
    if (!this.#outgoing.blocked) this.#outgoing.push(this.#options.session.messagesToSend().map(encodeMessage));
    this.#drop(NORMAL);
  }

  // ---- one connection

  get #isConnecting(): boolean {
    return this.#socket !== null || this.#question !== null;
  }

  #connect(): void {
    clearTimeout(this.#retryTimer);
    this.#attempt += 1;
    this.#refusal = null;
    this.#welcomedMs = null;
    this.#options.onLinkState({ state: "connecting", attempt: this.#attempt });
    const token = this.#access.show();
    if (token instanceof Promise) this.#ask(token, (present) => this.#dial(present));
    else this.#dial(token);
  }

  /**
   * Continue with the answer of a token function. If it fails, the connection counts as lost: perhaps it asks a server over the
   * line that is down. An answer that comes after the link has moved on is dropped.
   */
  #ask<Answer>(asked: Promise<Answer>, use: (answer: Answer) => void): void {
    this.#questions += 1;
    const question = this.#questions;
    this.#question = question;
    clearTimeout(this.#welcomeTimer);
    this.#welcomeTimer = setTimeout(
      () => this.#lost(ABNORMAL, "the token's function did not answer in time"),
      CONNECT_MS,
    );
    asked.then(
      (answer) => {
        if (this.#question !== question) return;
        this.#question = null;
        clearTimeout(this.#welcomeTimer);
        use(answer);
      },
      (error: unknown) => {
        if (this.#question !== question) return;
        this.#lost(ABNORMAL, `the token's function failed: ${error instanceof Error ? error.message : String(error)}`);
      },
    );
  }

  #dial(token: string | undefined): void {
    const protocols: string[] = [SUBPROTOCOL];
    if (token !== undefined) protocols.push(tokenSubprotocol(token));
    const socket = this.#opened(this.#url, protocols);
    if (socket === null) return;
    this.#socket = socket;
    socket.onopen = () => {
      this.#options.session.connected();
      this.pump();
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer | string>) => this.#take(event.data);
    socket.onclose = (event) => this.#lost(event.code, event.reason);
    // A close follows, but for implementations that forget it where no connection came about.
    socket.onerror = () => {
      setTimeout(() => {
        if (this.#socket === socket) this.#lost(ABNORMAL, "");
      }, 100);
    };
    this.#welcomeTimer = setTimeout(() => this.#cut(CLOSE_CODES.timeout, "no welcome in time"), CONNECT_MS);
    this.#watch = setInterval(() => this.#listen(), SILENCE_MS / 6);
  }

  /** A new socket; null where the platform refuses the address, as `ws:` from a page that came by https. */
  #opened(url: string, protocols: string[]): WebSocket | null {
    try {
      const socket = new this.#options.WebSocket(url, protocols);
      socket.binaryType = "arraybuffer";
      return socket;
    } catch (error) {
      const message = error instanceof Error ? error.message : String(error);
      this.#options.onLinkState({ state: "closed", closeCode: ABNORMAL, code: "invalid_url", message });
      return null;
    }
  }

  #take(data: ArrayBuffer | string): void {
    this.#receivedMs = performance.now();
    try {
      this.#options.session.receive(typeof data === "string" ? data : new Uint8Array(data));
    } catch (error) {
      if (!(error instanceof ProtocolViolation)) throw error;
      // What was right before it has happened.
      this.#report();
      this.refuse(error.message);
      return;
    }
    this.pump();
  }

  #report(): void {
    const events = this.#options.session.events();
    for (const event of events) this.#note(event);
    if (events.length > 0) this.#options.handle(events);
  }

  /** Take what concerns the connection itself. */
  #note(event: SessionEvent): void {
    if (event.type === "opened") {
      clearTimeout(this.#welcomeTimer);
      this.#welcomedMs = performance.now();
      this.#wasWelcomed = true;
      this.#outgoing.allow(event.limits.max_messages_per_s);
      this.#options.onLinkState({ state: "open" });
    } else if (event.type === "ready") {
      this.#attempt = 0;
    } else if (event.type === "refused" && event.fatal) {
      this.#refusal = event;
    } else if (event.type === "notice" && event.reconnectAfterMs !== null) {
      this.#firstWaitMs = event.reconnectAfterMs;
    }
  }

  /** Send the newest aim, now or when it may be sent. */
  #aim(): void {
    const pauseMs = this.#nextAimMs - performance.now();
    if (pauseMs <= 0) {
      this.#nextAimMs = performance.now() + AIM_PERIOD_MS;
      this.#options.session.flushAim();
    } else {
      this.#aimTimer ??= setTimeout(() => {
        this.#aimTimer = undefined;
        this.pump();
      }, pauseMs);
    }
  }

  /** Give up a connection on which a server that owes an answer is silent. */
  #listen(): void {
    if (this.#owedSinceMs === null || this.#welcomedMs === null) return;
    const sinceMs = Math.max(this.#owedSinceMs, this.#receivedMs, this.#welcomedMs);
    if (performance.now() - sinceMs > SILENCE_MS) this.#cut(CLOSE_CODES.timeout, "the server is silent");
  }

  /** Close from this side, without waiting for the other: its answer may never come. */
  #cut(closeCode: number, reason: string): void {
    this.#socket?.close(closeCode, reason);
    this.#lost(closeCode, reason);
  }

  #lost(closeCode: number, reason: string): void {
    if (!this.#isConnecting || this.#hasLeft) return;
    this.#drop(NORMAL);
    // What the loss did to landings is reported before the loss itself.
    this.#report();
    // A listener may have left, or connected again.
    if (this.#hasLeft || this.#isConnecting) return;
    const livedMs = this.#welcomedMs === null ? 0 : performance.now() - this.#welcomedMs;
    if (livedMs >= STABLE_MS) this.#attempt = 0;
    const code = this.#refusal?.code ?? codeOfClose(closeCode);
    const message = this.#refusal?.message ?? (reason || textOf(closeCode));
    const after = afterClose(closeCode);
    const end = { closeCode, code, message };
    if (after === "again") this.#retry(end);
    else if (after === "token" && this.#wasWelcomed && this.#access.isRenewed) {
      this.#ask(this.#access.hasNewer(), (newer) => {
        if (newer) this.#retry(end);
        else this.#options.onLinkState({ state: "closed", ...end });
      });
    } else this.#options.onLinkState({ state: "closed", ...end });
  }

  /** Connect again, after a while. */
  #retry(end: { readonly closeCode: number; readonly code: string; readonly message: string }): void {
    // What a draining server asked for holds once; else longer from attempt to attempt, scattered by chance.
    const retryInMs = this.#firstWaitMs ?? waitMs(Math.max(0, this.#attempt - 1), Math.random());
    this.#firstWaitMs = null;
    this.#retryTimer = setTimeout(() => this.#connect(), retryInMs);
    this.#options.onLinkState({ state: "waiting", attempt: this.#attempt + 1, retryInMs, ...end });
  }

  /** Part from the socket and from everything that was timed for it. */
  #drop(closeCode: number): void {
    const socket = this.#socket;
    this.#socket = null;
    this.#question = null;
    for (const timer of [this.#welcomeTimer, this.#aimTimer, this.#retryTimer]) clearTimeout(timer);
    this.#aimTimer = undefined;
    clearInterval(this.#watch);
    this.#outgoing.clear();
    this.#owedSinceMs = null;
    if (socket === null) return;
    // Handlers first: a socket that closes may still deliver what was under way.
    socket.onopen = socket.onmessage = socket.onclose = socket.onerror = null;
    socket.close(closeCode);
    this.#options.session.connectionLost();
  }
}

function textOf(closeCode: number): string {
  return closeCode === ABNORMAL ? "no connection to the server" : `the connection was closed with ${closeCode}`;
}
