/** The connection's own rules, against a server that answers and a clock that is wound by hand. */

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { Link } from "../../src/core/client/link.ts";
import { Outgoing } from "../../src/core/client/outgoing.ts";
import type { SessionEvent } from "../../src/core/session/events.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import type { LinkState, Token } from "../../src/core/types.ts";
import { tokenSubprotocol } from "../../src/core/wire/messages.ts";
import { AnsweringServer } from "./answering-server.ts";
import { MIDDLE, TOY, toyWithin } from "./toy-scene.ts";

/** A WebSocket whose other end is the test. */
class StandInSocket {
  static all: StandInSocket[] = [];
  binaryType = "blob";
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: ArrayBuffer | string }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  onerror: (() => void) | null = null;
  readonly sent: Uint8Array<ArrayBuffer>[] = [];
  readonly closed: (number | undefined)[] = [];
  readonly url: string;
  readonly protocols: string[];
  server = new AnsweringServer();

  constructor(url: string, protocols: string[]) {
    this.url = url;
    this.protocols = protocols;
    StandInSocket.all.push(this);
  }

  send(data: Uint8Array<ArrayBuffer>): void {
    this.sent.push(data);
    this.server.receive(data);
  }

  close(code?: number): void {
    this.closed.push(code);
  }

  /** Let the server say all that it has to say. */
  talk(): void {
    for (let data = this.server.next(); data !== null; data = this.server.next()) {
      this.onmessage?.({ data: typeof data === "string" ? data : data.slice().buffer });
    }
  }

  open(): this {
    this.onopen?.();
    this.talk();
    return this;
  }

  lose(code = 1006, reason = ""): void {
    this.onclose?.({ code, reason });
  }
}

function newest(): StandInSocket {
  return StandInSocket.all.at(-1)!;
}

let session: ClientSession;
let link: Link;
let linkStates: LinkState[];
let events: SessionEvent[];

beforeEach(() => {
  vi.useFakeTimers();
  StandInSocket.all = [];
  linkStates = [];
  events = [];
  const options = { client: "t", budgets: {}, creditBytes: 1 << 20 } as const;
  session = new ClientSession(options, 1 << 20);
  link = linkWith("t0ken/+");
  link.start();
});

function linkWith(token: Token): Link {
  return new Link({
    session,
    url: "ws://h/scenes/toy/stream",
    token,
    WebSocket: StandInSocket as unknown as typeof WebSocket,
    handle: (sessionEvents) => {
      events.push(...sessionEvents);
      for (const event of sessionEvents) {
        const whole = event.type === "whole" ? TOY.find(({ key }) => key === event.key) : undefined;
        if (whole !== undefined) session.checked(whole.key, whole.bounds);
      }
    },
    onLinkState: (state) => linkStates.push(state),
  });
}

afterEach(() => {
  link.leave();
  vi.useRealTimers();
});

test("the token goes into an entry of the subprotocols, never into the address", () => {
  expect(newest().url).toBe("ws://h/scenes/toy/stream");
  expect(newest().protocols).toEqual(["terraport.v2.msgpack", "terraport.token.dDBrZW4vKw"]);
  expect(newest().binaryType).toBe("arraybuffer");
});

describe("a connection", () => {
  test("without a welcome is given up after 10 s", () => {
    newest().onopen?.();
    vi.advanceTimersByTime(9_999);
    expect(newest().closed).toEqual([]);
    vi.advanceTimersByTime(1);
    expect(newest().closed[0]).toBe(4408);
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting", attempt: 2, closeCode: 4408, code: "timeout" });
  });

  test("that cannot be made is tried again: 0.5 s, 1 s, 2 s, 4 s at most, half of it at least", () => {
    for (const maxWaitMs of [500, 1000, 2000, 4000]) {
      const countBefore = StandInSocket.all.length;
      newest().lose();
      const state = linkStates.at(-1);
      if (state?.state !== "waiting") throw new Error(`is ${state?.state}`);
      expect(state.retryInMs).toBeGreaterThanOrEqual(maxWaitMs / 2);
      expect(state.retryInMs).toBeLessThanOrEqual(maxWaitMs);
      vi.advanceTimersByTime(state.retryInMs);
      expect(StandInSocket.all.length).toBe(countBefore + 1);
    }
  });

  test("that readied a landing begins the waits anew", () => {
    for (let attempt = 0; attempt < 4; attempt++) {
      newest().lose();
      const state = linkStates.at(-1);
      vi.advanceTimersByTime(state?.state === "waiting" ? state.retryInMs : 0);
    }
    newest().open();
    session.land(MIDDLE, 2);
    link.pump();
    newest().talk();
    expect(events.at(-1)?.type).toBe("ready");
    newest().lose();
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting", attempt: 1 });
  });

  test("is made again after the time that the server names, once", () => {
    newest().open();
    newest().server.send({ type: "notice", kind: "draining", reconnect_after_ms: 7000 });
    newest().talk();
    newest().lose(4503, "draining");
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting", retryInMs: 7000, code: "draining" });
    vi.advanceTimersByTime(7000);
    newest().lose();
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting" });
    expect(linkStates.at(-1)).not.toMatchObject({ retryInMs: 7000 });
  });

  test.each([4400, 4401, 4403, 4404, 4409, 4413, 1000])("closed with %d is not made again", (code) => {
    newest().open();
    newest().lose(code);
    expect(linkStates.at(-1)).toMatchObject({ state: "closed", closeCode: code });
    vi.advanceTimersByTime(120_000);
    expect(StandInSocket.all.length).toBe(1);
  });

  test("on which the server breaks the protocol is closed with 4400, for good", () => {
    newest().open();
    newest().onmessage?.({ data: Uint8Array.of(0xc1).buffer });
    expect(newest().closed[0]).toBe(4400);
    expect(linkStates.at(-1)).toMatchObject({ state: "closed", closeCode: 4400, code: "malformed" });
  });

  test("whose server owes an answer is given up after 30 s of silence, and not before", () => {
    const socket = newest().open();
    vi.advanceTimersByTime(300_000);
    expect(socket.closed).toEqual([]);
    session.land(MIDDLE, 2);
    link.pump();
    vi.advanceTimersByTime(29_000);
    expect(socket.closed).toEqual([]);
    vi.advanceTimersByTime(7_000);
    expect(socket.closed[0]).toBe(4408);
    vi.advanceTimersByTime(1000);
    newest().open();
    newest().talk();
    expect(events.at(-1)?.type).toBe("ready");
  });
});

describe("reconnect", () => {
  test("cuts a wait short, and does nothing to an open connection", () => {
    newest().lose();
    link.reconnect(undefined);
    expect(StandInSocket.all.length).toBe(2);
    newest().open();
    link.reconnect(undefined);
    link.reconnect("t0ken/+");
    vi.advanceTimersByTime(60_000);
    expect(StandInSocket.all.length).toBe(2);
  });

  test("with another token connects anew with it, after a refusal too", () => {
    newest().lose(4401);
    expect(linkStates.at(-1)).toMatchObject({ state: "closed", code: "unauthorised" });
    link.reconnect("other");
    expect(newest().protocols[1]).toBe("terraport.token.b3RoZXI");
    newest().open();
    link.reconnect("third");
    expect(StandInSocket.all.length).toBe(3);
    expect(StandInSocket.all[1]?.closed).toEqual([1000]);
  });
});

describe("a function of tokens", () => {
  let present: string;
  let asked: number;
  let source: () => string | Promise<string>;

  async function settle(ms = 0): Promise<void> {
    await vi.advanceTimersByTimeAsync(ms);
  }

  function shown(): string | undefined {
    return newest().protocols[1];
  }

  beforeEach(async () => {
    link.leave();
    StandInSocket.all = [];
    linkStates = [];
    present = "first";
    asked = 0;
    source = () => present;
    link = linkWith(() => {
      asked += 1;
      return source();
    });
    link.start();
    await settle();
  });

  test("is asked before each connection, and a refused token that it has renewed is no end", async () => {
    expect([shown(), asked]).toEqual([tokenSubprotocol("first"), 1]);
    newest().open();
    present = "second";
    newest().lose(4401);
    await settle();
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting", code: "unauthorised" });
    await settle(1000);
    expect([shown(), StandInSocket.all.length]).toEqual([tokenSubprotocol("second"), 2]);
    newest().open();
    newest().lose();
    present = "third";
    await settle(1000);
    expect(shown()).toBe(tokenSubprotocol("third"));
  });

  test("that has no other is the end, as is a token that was never known", async () => {
    newest().lose(4401);
    await settle(60_000);
    expect([linkStates.at(-1)?.state, asked]).toEqual(["closed", 1]);
    link.reconnect(undefined);
    await settle();
    newest().open();
    newest().lose(4401);
    await settle(60_000);
    expect(linkStates.at(-1)).toMatchObject({ state: "closed", closeCode: 4401 });
    expect(StandInSocket.all.length).toBe(2);
  });

  test("that fails, or does not answer in 10 s, is a line that is down", async () => {
    newest().open();
    source = () => Promise.reject(new Error("no login"));
    newest().lose();
    await settle(600);
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting", message: "the token's function failed: no login" });
    let answer = (_token: string): void => undefined;
    source = () =>
      new Promise((resolve) => {
        answer = resolve;
      });
    await settle(1000);
    expect(linkStates.at(-1)).toMatchObject({ state: "connecting" });
    await settle(10_000);
    expect(linkStates.at(-1)).toMatchObject({ state: "waiting" });
    // Too late: the next question is another.
    answer("late");
    source = () => "in time";
    await settle(4000);
    expect([shown(), StandInSocket.all.length]).toEqual([tokenSubprotocol("in time"), 2]);
  });

  test("is asked no more once a token was given by hand, or the link has left", async () => {
    newest().open();
    let answer = (_token: string): void => undefined;
    source = () =>
      new Promise((resolve) => {
        answer = resolve;
      });
    newest().lose();
    await settle(1000);
    link.reconnect("by hand");
    expect(shown()).toBe(tokenSubprotocol("by hand"));
    answer("late");
    await settle();
    expect([StandInSocket.all.length, asked]).toEqual([2, 2]);
    link.leave();
    await settle(60_000);
    expect(StandInSocket.all.length).toBe(2);
  });
});

test("aims go ten times a second at most, the newest always", () => {
  newest().open();
  for (let ms = 0; ms < 1000; ms += 10) {
    session.aim([ms / 100, 0, 0], 1);
    link.pump();
    vi.advanceTimersByTime(10);
  }
  vi.advanceTimersByTime(200);
  const aims = newest().server.received.filter((message) => message.type === "prefetch");
  expect(aims.length).toBeGreaterThanOrEqual(10);
  expect(aims.length).toBeLessThanOrEqual(11);
  expect(aims.at(-1)).toMatchObject({ position: [9.9, 0, 0] });
});

test("however fast the user lands, the server's rate is kept and one landing waits", () => {
  newest().open();
  for (let count = 0; count < 3000; count++) {
    session.land(MIDDLE, 1 + count / 1000);
    link.pump();
  }
  const lands = () => newest().server.received.filter((message) => message.type === "land");
  expect(lands().length).toBeLessThanOrEqual(480);
  vi.advanceTimersByTime(1000);
  newest().talk();
  expect(lands().length).toBeLessThanOrEqual(482);
  expect(lands().at(-1)?.radius_m).toBe(3.999);
  link.pump();
  expect([...session.shownKeys].sort()).toEqual(
    toyWithin(MIDDLE, 3.999)
      .map(({ key }) => key)
      .sort(),
  );
});

test("leaving says goodbye, and nothing is done afterwards", () => {
  newest().open();
  link.leave();
  expect(newest().server.received.at(-1)?.type).toBe("bye");
  expect(newest().closed).toEqual([1000]);
  link.reconnect("other");
  vi.advanceTimersByTime(60_000);
  expect(StandInSocket.all.length).toBe(1);
});

test("outgoing messages keep their order over a pause", () => {
  const sent: Uint8Array[] = [];
  let drained = 0;
  const outgoing = new Outgoing(
    (data) => sent.push(data),
    () => {
      drained += 1;
    },
  );
  outgoing.allow(10);
  const messages = Array.from({ length: 100 }, (_, at) => Uint8Array.of(at));
  outgoing.push(messages.slice(0, 90));
  outgoing.push(messages.slice(90));
  expect(sent.length).toBe(80);
  expect(outgoing.blocked).toBe(true);
  vi.advanceTimersByTime(1000);
  expect(sent.length).toBe(88);
  vi.advanceTimersByTime(2000);
  expect(sent).toEqual(messages);
  expect([outgoing.blocked, drained]).toEqual([false, 1]);
});
