/** What strokes taught, as a server gives it: unpacked, checked, bounded. Served by Node. */

import { createServer, type IncomingMessage, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import { deflateSync } from "node:zlib";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { fetchTaught, listStrokes, paintStroke, takeBackStroke } from "../src/core/extras/strokes.ts";
import { texelsOf } from "../src/three/taught-look.ts";

const packed = (...bytes: number[]) => deflateSync(Uint8Array.from(bytes)).toString("base64");

const TAUGHT = {
  format: "terraport-taught",
  format_version: "1.0",
  strokes: "00112233aabbccdd",
  state: "taught",
  text: "learned",
  names: [
    { name: "bench", colour: "#ff8000", area_m2: 12.5, confidence: 0.9 },
    { name: "road", colour: "#102030", area_m2: 3, confidence: 0.6 },
  ],
  corner_m: [-2, 4],
  cell_m: 0.5,
  rows: 1,
  columns: 3,
  kind: packed(1, 0, 255),
  doubt: packed(0, 255, 7),
  places: [{ position: [1, 2], doubt: 0.9, likeliest: "bench", or: "road" }],
};
const STROKE = {
  id: "0123456789abcdef",
  name: "road",
  colour: "#102030",
  width_m: 3,
  line: [
    [1, 2],
    [3, 4],
  ],
  who: "anna",
  when: "2026-11-24T09:12:07Z",
  yours: true,
};

let server: Server;
let url: string;
let answer: { status: number; body: unknown };
let asked: { method: string | undefined; url: string | undefined; body: string; headers: IncomingMessage["headers"] }[];

beforeEach(async () => {
  asked = [];
  server = createServer(async (request, response) => {
    let body = "";
    for await (const chunk of request) body += String(chunk);
    asked.push({ method: request.method, url: request.url, body, headers: request.headers });
    response.writeHead(answer.status, { "Content-Type": "application/json" });
    response.end(answer.status === 204 ? undefined : JSON.stringify(answer.body));
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  url = `http://127.0.0.1:${(server.address() as AddressInfo).port}/scenes/pit`;
});

afterEach(() => {
  server.close();
});

describe("what strokes taught", () => {
  it("is a picture of names and doubt", async () => {
    answer = { status: 200, body: TAUGHT };
    const taught = await fetchTaught(url, {});
    expect(taught?.revision).toBe("00112233aabbccdd");
    const picture = taught!.picture!;
    expect([...picture.kind]).toEqual([1, 0, 255]);
    expect(picture.places).toEqual([{ position: [1, 2], doubt: 0.9, likeliest: "bench", other: "road" }]);
    // Alpha is doubt, and 255 where there is no ground.
    expect([...texelsOf(picture)]).toEqual([16, 32, 48, 0, 255, 128, 0, 254, 255, 255, 255, 255]);
  });

  it("is nothing where nobody taught, and has no picture where it was refused", async () => {
    answer = { status: 204, body: null };
    expect(await fetchTaught(url, {})).toBeNull();
    const { format, format_version, strokes } = TAUGHT;
    answer = { status: 200, body: { format, format_version, strokes, state: "refused", text: "one name" } };
    expect((await fetchTaught(url, {}))?.picture).toBeNull();
  });

  it.each([
    ["another format", { format: "terraport-labels" }],
    ["the next major version", { format_version: "2.0" }],
    ["too few squares", { kind: packed(1) }],
    ["more squares than it says", { kind: packed(...Array<number>(4000).fill(0)) }],
    ["more squares than there may be", { rows: 2000, columns: 2000 }],
    ["what is no base64", { doubt: "?" }],
    ["what does not unpack", { doubt: "AAAA" }],
    ["a colour that is none", { names: [{ ...TAUGHT.names[0], colour: "url(x)" }] }],
    ["squares without a side", { cell_m: 0 }],
  ])("is refused with %s", async (_, change) => {
    answer = { status: 200, body: { ...TAUGHT, ...change } };
    await expect(fetchTaught(url, {})).rejects.toMatchObject({ code: "damaged" });
  });
});

describe("strokes", () => {
  it("are listed, painted and taken back, with the token", async () => {
    answer = { status: 200, body: { strokes: [STROKE], revision: "r1" } };
    const { strokes, revision } = await listStrokes(url, { token: "t" });
    expect(revision).toBe("r1");
    expect(strokes[0]).toMatchObject({ widthM: 3, who: "anna", isOwn: true });
    answer = { status: 201, body: { stroke: STROKE, revision: "r2" } };
    const line = [[1, 2], [3, 4]] as const; // biome-ignore format: a line
    const painted = await paintStroke(url, { name: "road", colour: "#102030", widthM: 3, line }, { token: "t" });
    expect(painted.revision).toBe("r2");
    answer = { status: 200, body: { revision: "r3" } };
    expect(await takeBackStroke(url, "0123456789abcdef", { token: "t" })).toBe("r3");
    expect(asked.map(({ method, url: path }) => `${method} ${path}`)).toEqual([
      "GET /scenes/pit/strokes",
      "POST /scenes/pit/strokes",
      "DELETE /scenes/pit/strokes/0123456789abcdef",
    ]);
    expect(JSON.parse(asked[1]!.body)).toEqual({ name: "road", colour: "#102030", width_m: 3, line });
    expect(asked[1]!.headers["content-type"]).toBe("application/json");
    expect(asked.every(({ headers }) => headers.authorization === "Bearer t")).toBe(true);
  });

  it("are refused in the server's words", async () => {
    answer = { status: 429, body: { error: { code: "too_many", message: "got more strokes" } } };
    const stroke = { name: "x", colour: "#000000", widthM: 1, line: [] };
    await expect(paintStroke(url, stroke, {})).rejects.toMatchObject({ code: "too_many", message: "got more strokes" });
  });
});
