/** The landings corpus (tests/conformance/landings): every history, step by step. */

import { readdirSync, readFileSync } from "node:fs";
import { crc32, gunzipSync } from "node:zlib";
import { describe, expect, test } from "vitest";
import { segmentBounds } from "../../src/core/payload/segment-format.ts";
import type { SessionEvent } from "../../src/core/session/events.ts";
import { ClientSession } from "../../src/core/session/session.ts";
import type { Vec3 } from "../../src/core/types.ts";
import type { ClientMessage } from "../../src/core/wire/messages.ts";
import { encodeMessage } from "../../src/core/wire/messages.ts";

const CORPUS = new URL("../../../../tests/conformance/landings/", import.meta.url);

type Told = Record<string, unknown>;

interface History {
  readonly history: string;
  readonly options: { readonly credit_bytes: number; readonly max_segments: number | null };
  readonly steps: readonly (readonly unknown[])[];
}

describe.each(readdirSync(CORPUS).filter((name) => name.endsWith(".jsonl")))("the landings corpus: %s", (name) => {
  const histories = readFileSync(new URL(name, CORPUS), "utf-8").trimEnd().split("\n");

  test.each(histories.map((line) => JSON.parse(line) as History))("$history", async (history) => {
    const player = new Player(history.options);
    for (const [at, step] of history.steps.entries()) {
      const told = await player.play(step.slice(0, -1) as [string, ...never[]]);
      expect(told, `step ${at}: ${JSON.stringify(step).slice(0, 80)}`).toEqual(step.at(-1));
    }
  });
});

class Player {
  readonly #session: ClientSession;
  #told: Told = {};
  #shown = { shown: [] as readonly string[], hidden: "00000000" };

  constructor({ credit_bytes: creditBytes, max_segments: maxSegments }: History["options"]) {
    const budgets = maxSegments === null ? {} : { maxSegments };
    this.#session = new ClientSession({ client: "corpus", budgets, creditBytes }, 2 ** 30);
  }

  async play([command, ...given]: readonly [string, ...never[]]): Promise<Told> {
    const session = this.#session;
    const before = this.#shown;
    this.#told = {};
    this.#perform(command, given);
    for (let events = session.events(); events.length > 0; events = session.events()) {
      for (const event of events) await this.#note(event);
    }
    for (const name of ["shown", "hidden"] as const) {
      if (JSON.stringify(this.#shown[name]) !== JSON.stringify(before[name])) this.#told[name] = this.#shown[name];
    }
    return this.#told;
  }

  #perform(command: string, given: readonly never[]): void {
    const session = this.#session;
    const [first, second, third, fourth] = given as readonly unknown[];
    if (command === "connected") session.connected();
    else if (command === "lost") session.connectionLost();
    else if (command === "receive") session.receive(new Uint8Array(Buffer.from(first as string, "base64")));
    else if (command === "hurry") session.hurry(first as number);
    else if (command === "pick") session.pick(first as Vec3);
    else if (command === "send") this.#told.sent = session.messagesToSend().map(plain);
    else if (command === "aim") {
      session.aim(first as Vec3, second as number);
      session.flushAim();
    } else if (command === "land") {
      const optional = { innerRadiusM: third ?? undefined, coarseRadiusM: fourth ?? undefined };
      session.land(first as Vec3, second as number, optional as object);
    } else throw new Error(`got step ${command}, expected one of the README`);
  }

  async #note(event: SessionEvent): Promise<void> {
    if (event.type === "whole") {
      const bounds = await segmentBounds(event.payload).catch(() => null);
      if (bounds === null) this.#session.damaged(event.key);
      else this.#session.checked(event.key, bounds);
    } else if (event.type === "degraded") {
      this.#told.inner = [event.rows.length, hash(gunzipSync(event.hidden))];
    } else if (event.type === "ready") {
      this.#shown = { shown: [...this.#session.shownKeys].sort(), hidden: hash(gunzipSync(event.hidden)) };
    } else if (event.type === "opened" && event.changed) this.#shown = { shown: [], hidden: "00000000" };
  }
}

function hash(bits: Uint8Array): string {
  return crc32(bits).toString(16).padStart(8, "0");
}

/** A message as the corpus has it: without what is absent, keys ascending. */
function plain(message: ClientMessage): object {
  encodeMessage(message); // Only messages that can be sent are compared.
  const sorted = Object.entries(message).map(([name, value]) => {
    const isKeys = name === "have" || name === "without";
    return [name, isKeys && Array.isArray(value) ? [...value].sort() : value];
  });
  return JSON.parse(JSON.stringify(Object.fromEntries(sorted)));
}
