/** Holds one stream: socket, session, cache; decoding goes to workers of its own. */

import { decodeSegment } from "../payload/segment-format.ts";
import { DecodePool } from "./decode-pool.ts";
import { DiskCache } from "./disk-cache.ts";
import { imageDecoder } from "./image-decoder.ts";
import { StreamCore, type StreamCorePlatform } from "./stream-core.ts";
import { transferablesOfMesh } from "./transferables.ts";
import { sentError } from "./worker-errors.ts";
import type { StreamAnswer, StreamCommand, StreamMessage, StreamQuestion } from "./worker-messages.ts";

/** How long the goodbye may take to leave. */
const GOODBYE_MS = 200;

let core: StreamCore | null = null;
let closePool = () => {};

function post(message: StreamMessage, transfer: Transferable[] = []): void {
  self.postMessage(message, { transfer });
}

function crash(error: unknown): void {
  post({ type: "crashed", error: sentError(error) });
}

function open(command: StreamCommand & { type: "open" }): void {
  const { sceneUrl, diskBytes = 0 } = command.options;
  const options = command.asksForTokens ? { ...command.options, token: askForToken } : command.options;
  core = new StreamCore(options, {
    WebSocket,
    decode: decoder(command.decoders),
    disk: diskBytes > 0 ? new DiskCache(sceneUrl, diskBytes) : undefined,
    emit: (event) => post({ type: "event", event }),
  });
  core.start().catch(crash);
}

/** Tokens that the page was asked for; the link gives each up after 10 s, and asks for few at a time. */
const wanted = new Map<number, { resolve: (token: string) => void; reject: (error: Error) => void }>();
let questions = 0;

function askForToken(): Promise<string> {
  questions += 1;
  const question = questions;
  return new Promise((resolve, reject) => {
    wanted.set(question, { resolve, reject });
    post({ type: "token-wanted", question });
  });
}

function takeToken({ question, token, error }: StreamCommand & { type: "token" }): void {
  const asked = wanted.get(question);
  wanted.delete(question);
  if (token !== undefined) asked?.resolve(token);
  else asked?.reject(new Error(error?.message ?? "it gave none"));
}

/** Decodes in a pool of workers; in this one on platforms whose workers cannot make workers. */
function decoder(count: number): StreamCorePlatform["decode"] {
  if (typeof Worker === "undefined") {
    return (payload, attributes) => decodeSegment(payload, attributes, imageDecoder());
  }
  const pool = new DecodePool(
    count,
    () => new Worker(new URL("./decode.worker.ts", import.meta.url), { type: "module", name: "terraport decode" }),
  );
  closePool = () => pool.close();
  return (payload, attributes) => pool.decode({ payload, attributes });
}

async function answer(stream: StreamCore, question: StreamQuestion): Promise<void> {
  const { id } = question;
  try {
    if (question.type === "mesh") {
      // Handed over, not copied: the cache keeps payloads, never meshes.
      const mesh = await stream.mesh(question.key, question.attributes);
      post({ type: "answer", id, value: mesh }, transferablesOfMesh(mesh));
      return;
    }
    const value: StreamAnswer =
      question.type === "pick" ? await stream.pick(question.origin, question.direction) : stream.stats();
    post({ type: "answer", id, value });
  } catch (error) {
    post({ type: "failed", id, error: sentError(error) });
  }
}

function execute(command: StreamCommand): void {
  if (command.type === "open") {
    open(command);
    return;
  }
  if (core === null) throw new Error(`got ${command.type} first, expected open`);
  if (command.type === "land") {
    const number = core.land(command.position, command.radiusM, command.options, command.askedMs);
    // The page has told its number to whoever asked; another one here would answer the wrong landing.
    if (number !== command.number) throw new Error(`landing ${command.number} of the page is ${number} here`);
  } else if (command.type === "aim") core.aim(command.position, command.radiusM, command.coarseRadiusM);
  else if (command.type === "group") core.group(command.command);
  else if (command.type === "token") takeToken(command);
  else if (command.type === "reconnect") core.reconnect(command.token);
  else if (command.type === "close") {
    core.close();
    closePool();
    // The page ends this worker when it hears of it, and `bye` with it if that has not left.
    setTimeout(() => post({ type: "closed" }), GOODBYE_MS);
  } else void answer(core, command);
}

self.onmessage = (event: MessageEvent<StreamCommand>) => {
  try {
    execute(event.data);
  } catch (error) {
    crash(error);
  }
};
self.addEventListener("error", (event) => crash(event.error ?? event.message));
self.addEventListener("unhandledrejection", (event) => crash(event.reason));
