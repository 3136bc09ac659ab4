/** One request over HTTP: bounded, with the server's own words where it refuses. A shell: it fetches. */

import { StreamError } from "./errors.ts";

/** How to reach a server. */
export interface HttpOptions {
  /** Sent as `Authorization: Bearer`; without one no such header is sent. */
  readonly token?: string | undefined;
  readonly signal?: AbortSignal | undefined;
  /** GET without it. */
  readonly method?: "POST" | "DELETE";
  /** Bytes of the file, `end` excluded; the whole file without it. */
  readonly range?: { readonly begin: number; readonly end: number };
  /** Sent as JSON. */
  readonly body?: object;
}

/** How much may come, and who is told of it. */
export interface Download {
  /** More than this is refused; where it is exact, less is as well. */
  readonly maxBytes: number;
  /** `maxBytes` is what must come. */
  readonly isExact: boolean;
  readonly onBytes?: (bytes: number) => void;
}

/** Codes by status, where the server gave none. */
const CODES: ReadonlyMap<number, string> = new Map([
  [401, "unauthorised"],
  [403, "forbidden"],
  [404, "unknown_scene"],
  [429, "too_many"],
  [503, "draining"],
]);
const MAX_ERROR_BYTES = 65_536;
const MAX_ERROR_CHARACTERS = 1024;
const MAX_JSON_BYTES = 16 * 2 ** 20;

/**
 * Fetch a JSON object.
 *
 * @throws StreamError As {@link fetchBytes}.
 */
export async function fetchJson(url: string, options: HttpOptions): Promise<Readonly<Record<string, unknown>>> {
  const bytes = await fetchBytes(url, options, { maxBytes: MAX_JSON_BYTES, isExact: false });
  const value = parseJson(bytes, url);
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as Record<string, unknown>;
  throw new StreamError("damaged", `${url} is no JSON object; is this a terraport server?`, 200);
}

/**
 * Parse a JSON file that came from `url`.
 *
 * @throws StreamError `damaged`.
 */
export function parseJson(bytes: Uint8Array, url: string): unknown {
  try {
    return JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch {
    throw new StreamError("damaged", `${url} is no JSON; is this a terraport server?`, 200);
  }
}

/**
 * Fetch a file. The token goes to that server alone: redirects are not followed.
 *
 * @throws StreamError `unreachable` without an answer; `origin_not_allowed` where there is one that the browser keeps from
 * this page; the server's code where it refuses; `damaged` where another length
 * comes than must.
 * @throws The signal's reason where it is aborted.
 */
export async function fetchBytes(
  url: string,
  { token, signal, method, body, range }: HttpOptions,
  download: Download,
): Promise<Uint8Array<ArrayBuffer>> {
  try {
    const response = await fetch(url, {
      method: method ?? "GET",
      headers: {
        ...(token === undefined ? {} : { Authorization: `Bearer ${token}` }),
        ...(body === undefined ? {} : { "Content-Type": "application/json" }),
        ...(range === undefined ? {} : { Range: `bytes=${range.begin}-${range.end - 1}` }),
      },
      body: body === undefined ? null : JSON.stringify(body),
      redirect: "error",
      signal: signal ?? null,
    });
    if (!response.ok) throw await refusal(url, response);
    if (range !== undefined && response.status !== 206) {
      throw new StreamError("damaged", `got all of ${url}, expected a server that gives ranges`, response.status);
    }
    return await readBody(url, response, download);
  } catch (error) {
    signal?.throwIfAborted();
    if (error instanceof StreamError) throw error;
    throw await withoutAnswer(url, signal, error);
  }
}

/**
 * Why `fetch` failed: browsers give the same error for a server that is away and for an answer that they keep from the page.
 * A request whose answer nobody wants to read tells the two apart.
 */
async function withoutAnswer(url: string, signal: AbortSignal | undefined, error: unknown): Promise<StreamError> {
  // Of the page, also in its workers; Node has none.
  const page = (globalThis as { origin?: string }).origin;
  const { origin, protocol } = new URL(url, page);
  const causedBy = { cause: error };
  if (page !== undefined && page !== origin) {
    if (protocol === "http:" && page.startsWith("https:") && !/^http:..(localhost|127\.|\[::1\])/.test(origin)) {
      const text = `a page of ${page} may not load from ${origin}; serve the scene by https too`;
      return new StreamError("unreachable", text, undefined, causedBy);
    }
    const answer = await fetch(url, { method: "HEAD", mode: "no-cors", signal: signal ?? null }).catch(() => null);
    signal?.throwIfAborted();
    if (answer !== null) {
      const text = `${origin} answers, but not to pages of ${page}; start the service with --allow-origin ${page}`;
      return new StreamError("origin_not_allowed", text, undefined, causedBy);
    }
  }
  const text = `no answer from ${url} (${reasonOf(error)}); is the server running, and reachable from here?`;
  return new StreamError("unreachable", text, undefined, causedBy);
}

async function readBody(url: string, response: Response, download: Download): Promise<Uint8Array<ArrayBuffer>> {
  const { maxBytes, isExact, onBytes } = download;
  let bytes = new Uint8Array(isExact ? maxBytes : Math.min(maxBytes, 65_536));
  let size = 0;
  for await (const chunk of chunksOf(response)) {
    // Stopped at the bound, not read to the end and then refused.
    if (chunk.length > maxBytes - size) {
      throw new StreamError(
        "damaged",
        `${url} has more than ${maxBytes} bytes, expected ${expectedText(download)}`,
        200,
      );
    }
    // Where no length was promised, memory grows with what has come, not with the bound.
    if (size + chunk.length > bytes.length) bytes = enlarged(bytes, Math.min(maxBytes, 2 * (size + chunk.length)));
    bytes.set(chunk, size);
    size += chunk.length;
    onBytes?.(chunk.length);
  }
  if (isExact && size !== maxBytes) {
    throw new StreamError(
      "damaged",
      `${url} has ${size} bytes, expected ${expectedText(download)}; load it again`,
      200,
    );
  }
  return bytes.subarray(0, size);
}

async function* chunksOf(response: Response): AsyncGenerator<Uint8Array> {
  if (response.body === null) return;
  // Not the body's own iterator: Safari has none.
  const reader = response.body.getReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      yield value;
    }
  } finally {
    // Left early, the rest must not go on coming.
    await reader.cancel().catch(() => undefined);
  }
}

function enlarged(bytes: Uint8Array, size: number): Uint8Array<ArrayBuffer> {
  const larger = new Uint8Array(size);
  larger.set(bytes);
  return larger;
}

function expectedText({ maxBytes, isExact }: Download): string {
  return isExact ? `${maxBytes} by the manifest` : `at most ${maxBytes}`;
}

async function refusal(url: string, response: Response): Promise<StreamError> {
  const { status } = response;
  const stated = await statedError(url, response);
  const code = stated.code ?? CODES.get(status) ?? "refused";
  const text = stated.message ?? `${url} was refused with HTTP status ${status}`;
  return new StreamError(code, `${text}${ADVICE.get(code) ?? ""}`, status);
}

/** What to do, where the server cannot know it. */
const ADVICE: ReadonlyMap<string, string> = new Map([
  ["unauthorised", "; give a token that the service knows"],
  ["forbidden", "; ask for a token that opens this scene"],
  ["draining", "; try again in a moment"],
]);

/** Code and text of our server's JSON error body, where it is one. */
async function statedError(url: string, response: Response): Promise<{ code?: string; message?: string }> {
  try {
    const body = await readBody(url, response, { maxBytes: MAX_ERROR_BYTES, isExact: false });
    const { error } = JSON.parse(new TextDecoder().decode(body)) as { error?: { code?: unknown; message?: unknown } };
    return {
      ...(typeof error?.code === "string" && { code: error.code }),
      ...(typeof error?.message === "string" && { message: error.message.slice(0, MAX_ERROR_CHARACTERS) }),
    };
  } catch {
    return {}; // a proxy's page, or nothing
  }
}

function reasonOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
