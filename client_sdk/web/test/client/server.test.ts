/**
 * The stream against a real server.
 *
 *     NODE_OPTIONS=--experimental-websocket TERRAPORT_URL=http://127.0.0.1:8080 npx vitest run test/client
 *
 * `TERRAPORT_SCENE` names the scene (`sample` without it); its surface must come near the origin of its frame. With
 * `TERRAPORT_PYTHON`, an interpreter that has the Python SDK, visible sets are compared with the SDK's. With
 * `TERRAPORT_TOKEN_URL` and `TERRAPORT_TOKEN`, a server that asks for that token, tokens are tested.
 */

import { execFile } from "node:child_process";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { afterEach, describe, expect, test } from "vitest";
import { loadScene } from "../../src/core/scene/load.ts";
import { sceneUrlOf } from "../../src/core/scene/urls.ts";
import type { Vec3 } from "../../src/core/types.ts";
import { type CuttingProxy, cuttingProxy } from "./cutting-proxy.ts";
import { type Listening, listening } from "./listening.ts";

const { TERRAPORT_URL, TERRAPORT_SCENE = "sample", TERRAPORT_PYTHON } = process.env;
const { TERRAPORT_TOKEN_URL, TERRAPORT_TOKEN } = process.env;
const HERE: Vec3 = [0, 10, 0];
const THERE: Vec3 = [60, 10, 60];

function why(): string | null {
  if (TERRAPORT_URL === undefined) return "TERRAPORT_URL names no server";
  if (typeof WebSocket === "undefined") return "this Node has no WebSocket: NODE_OPTIONS=--experimental-websocket";
  return null;
}

const skipped = why();
const open: Listening[] = [];
const proxies: CuttingProxy[] = [];

function listen(options: Partial<Parameters<typeof listening>[0]> = {}, serverUrl = TERRAPORT_URL): Listening {
  const listened = listening({ sceneUrl: sceneUrlOf(serverUrl ?? "", TERRAPORT_SCENE), ...options });
  open.push(listened);
  return listened;
}

async function throughProxy(): Promise<CuttingProxy> {
  const proxy = await cuttingProxy(TERRAPORT_URL ?? "");
  proxies.push(proxy);
  return proxy;
}

afterEach(async () => {
  for (const { stream, events } of open.splice(0)) {
    stream.close();
    // Events can be logged as JSON.
    expect(() => JSON.stringify(events)).not.toThrow();
  }
  for (const proxy of proxies.splice(0)) await proxy.close();
});

describe.skipIf(skipped !== null)(`on a real server${skipped === null ? "" : ` (skipped: ${skipped})`}`, () => {
  test("a landing, a hop and a return", async () => {
    const { stream, ready, of } = listen();
    const first = await ready(stream.land(HERE, 30));
    expect(first.payloadBytes).toBe(of("planned")[0]?.plan.loadBytes);
    expect(first.visible.length).toBeGreaterThan(0);
    const hop = await ready(stream.land(THERE, 30));
    const back = await ready(stream.land(HERE, 30));
    expect(back.visible).toEqual(first.visible);
    expect(back.payloadBytes).toBe(0);
    expect(first.missing.length + hop.missing.length + back.missing.length).toBe(0);
    const stats = await stream.stats();
    expect(stats.repeatedBytes).toBe(0);
    expect(stats.payloadBytes).toBe(first.payloadBytes + hop.payloadBytes);
    const arrived = of("arrived");
    expect(stats.heldBytes).toBe(arrived.reduce((sum, { bytes }) => sum + bytes, 0));
    const { manifest } = await loadScene(sceneUrlOf(TERRAPORT_URL ?? "", TERRAPORT_SCENE));
    for (const key of first.visible.slice(0, 4)) {
      const mesh = await stream.mesh(key, manifest.attributes);
      const row = of("planned")[0]?.plan.show.find((each) => each.key === key);
      expect([mesh.faceCount, mesh.vertexCount]).toEqual([row?.faces, row?.vertices]);
      expect(mesh.indices.length).toBe(3 * mesh.faceCount);
      expect(mesh.bounds).toEqual(arrived.find((each) => each.key === key)?.bounds);
    }
  });

  test("an aim, and the landing there has nothing left to load", async () => {
    const { stream, ready, until, of } = listen();
    await until("opened");
    for (let step = 0; step < 20; step++) stream.aim([THERE[0] + step / 100, 10, 60], 30);
    stream.aim(THERE, 30);
    // Nothing says that an aim is over.
    for (let before = -1; before < of("arrived").length; await new Promise((resolve) => setTimeout(resolve, 500))) {
      before = of("arrived").length || -1;
    }
    const landed = await ready(stream.land(THERE, 30));
    expect(of("planned")[0]?.plan.loadBytes).toBe(0);
    expect(landed.payloadBytes).toBe(0);
    expect(landed.visible.length).toBeGreaterThan(0);
    const stats = await stream.stats();
    expect([stats.aimedLandings, stats.aimHits]).toEqual([1, 1]);
  });

  test("over HTTP the same is shown, and nothing comes twice", async () => {
    const { stream, ready, of, until } = listen({ overHttp: true });
    const connected = listen();
    for (const [place, radiusM] of [
      [HERE, 30],
      [THERE, 30],
      [HERE, 30],
    ] as const) {
      const shown = await ready(stream.land(place, radiusM));
      const reference = await connected.ready(connected.stream.land(place, radiusM));
      expect([...shown.visible].sort()).toEqual([...reference.visible].sort());
      expect(shown.hidden).toEqual(reference.hidden);
      expect(shown.missing).toEqual([]);
    }
    expect(of("ready")[2]?.payloadBytes).toBe(0);
    expect((await stream.stats()).repeatedBytes).toBe(0);
    const aimed = [-40, 10, 40] as const;
    stream.aim(aimed, 20);
    await until("arrived", ({ landing }) => landing === null);
    const first = stream.land(aimed, 200);
    expect((await ready(stream.land(aimed, 20))).visible.length).toBeGreaterThan(0);
    expect(of("ready").some(({ landing }) => landing === first)).toBe(false);
    await expect(stream.pick(HERE)).rejects.toMatchObject({ code: "not_available" });
    stream.land(HERE, 100_000);
    expect(await until("refused")).toMatchObject({ code: "radius_too_large", fatal: false });
    expect((await ready(stream.land(HERE, 10))).missing).toEqual([]);
  });

  test("over HTTP an unknown scene is told, and not asked for again", async () => {
    const { until } = listen({ overHttp: true, sceneUrl: sceneUrlOf(TERRAPORT_URL ?? "", "no-such-scene") });
    const { link } = await until("link", (event) => event.link.state === "closed");
    expect(link).toMatchObject({ code: "unknown_scene" });
  });

  test("a newer landing supersedes the older", async () => {
    const { stream, ready, until, of } = listen({ creditBytes: 65_536 });
    const first = stream.land(HERE, 300);
    await until("planned");
    const second = stream.land(THERE, 20);
    const landed = await ready(second);
    expect(of("superseded")).toEqual([{ type: "superseded", landing: first, by: second }]);
    expect(of("ready").map((event) => event.landing)).toEqual([second]);
    const alone = listen();
    expect(landed.visible).toEqual((await alone.ready(alone.stream.land(THERE, 20))).visible);
  });

  test("a cut line is mended, no segment comes twice, and picks are answered", async () => {
    const proxy = await throughProxy();
    proxy.cutAfterBytes = 75_000; // Of some 150,000.
    const { stream, ready, of, until } = listen({ creditBytes: 65_536 }, proxy.url);
    const landing = stream.land(HERE, 120);
    await until("link", ({ link }) => link.state === "waiting");
    const pick = stream.pick([0, 100, 0], [0, -1, 0]);
    proxy.cutAfterBytes = null;
    const landed = await ready(landing);
    expect(proxy.connections).toBe(2);
    const wholeIds = of("arrived").map((event) => event.key);
    expect(new Set(wholeIds).size).toBe(wholeIds.length);
    expect((await stream.stats()).repeatedBytes).toBe(0);
    expect(landed.elapsedMs).toBeGreaterThan(200);
    expect((await pick)?.segment).toBeTypeOf("number");
    const alone = listen();
    expect(landed.visible).toEqual((await alone.ready(alone.stream.land(HERE, 120))).visible);
  });

  test("a server that is away is asked again, later each time, and at once by reconnect", async () => {
    const proxy = await throughProxy();
    proxy.refuse = true;
    const { stream, ready, of, until } = listen({}, proxy.url);
    const landing = stream.land(HERE, 20);
    const waits = () => of("link").flatMap(({ link }) => (link.state === "waiting" ? [link] : []));
    await until("link", ({ link }) => link.state === "waiting" && link.attempt === 3);
    expect(waits().map((link) => link.attempt)).toEqual([2, 3]);
    expect(waits()[0]?.retryInMs).toBeLessThanOrEqual(500);
    expect(waits()[1]?.retryInMs).toBeGreaterThanOrEqual(500);
    proxy.refuse = false;
    stream.reconnect();
    expect((await ready(landing)).visible.length).toBeGreaterThan(0);
  });

  test("what cannot be is refused where it is said, or by the server", async () => {
    const { stream, until, ready } = listen();
    expect(() => stream.land([Number.NaN, 0, 0], 10)).toThrow(RangeError);
    expect(() => stream.aim(HERE, -1)).toThrow(RangeError);
    await expect(stream.pick(HERE, [0, 0, 0])).rejects.toThrow(RangeError);
    await expect(stream.mesh("0123456789abcdef", [])).rejects.toMatchObject({ name: "StreamError", code: "not_held" });
    const far = stream.land(HERE, 100_000);
    const refused = await until("refused");
    expect(refused).toMatchObject({ landing: far, code: "radius_too_large", fatal: false });
    expect((await ready(stream.land(HERE, 10))).landing).toBe(far + 1);
  });

  test("an unknown scene is told, and not asked for again", async () => {
    const { stream, until, of } = listen({ sceneUrl: sceneUrlOf(TERRAPORT_URL ?? "", "no-such-scene") });
    const pick = stream.pick(HERE);
    pick.catch(() => {});
    const { link } = await until("link", (event) => event.link.state === "closed");
    expect(link).toMatchObject({ code: "unknown_scene", closeCode: 4404 });
    await expect(pick).rejects.toMatchObject({ code: "unknown_scene" });
    await expect(stream.pick(HERE)).rejects.toMatchObject({ code: "unknown_scene" });
    expect(of("link").filter((event) => event.link.state === "connecting").length).toBe(1);
  });

  test("after close nothing comes, and who waits is told", async () => {
    const { stream, ready, events } = listen();
    await ready(stream.land(HERE, 20));
    stream.land(THERE, 50);
    const pick = stream.pick(HERE);
    const count = events.length;
    stream.close();
    await expect(pick).rejects.toMatchObject({ code: "closed" });
    await expect(stream.mesh("0123456789abcdef", [])).rejects.toMatchObject({ code: "closed" });
    await new Promise((resolve) => setTimeout(resolve, 200));
    expect(events.length).toBe(count);
  });

  test.skipIf(TERRAPORT_PYTHON === undefined)(
    "visible sets are those of the Python SDK",
    async () => {
      const positions = Array.from({ length: 12 }, (_, at) => {
        const angle = at * 2.4;
        return [Math.cos(angle) * 12 * at, 10, Math.sin(angle) * 12 * at, 10 + ((at * 7) % 40)] as const;
      });
      const script = fileURLToPath(new URL("./land_with_sdk.py", import.meta.url));
      const url = sceneUrlOf(TERRAPORT_URL ?? "", TERRAPORT_SCENE);
      const { stdout } = await promisify(execFile)(TERRAPORT_PYTHON ?? "", [script, url, JSON.stringify(positions)]);
      const expected = stdout
        .trim()
        .split("\n")
        .map((line) => JSON.parse(line));
      const { stream, ready, until } = listen();
      const visibleSets: (readonly number[])[] = [];
      for (const [x, y, z, radiusM] of positions) {
        const landing = stream.land([x, y, z], radiusM);
        const { plan } = await until("planned", (event) => event.plan.landing === landing);
        const visible = new Set((await ready(landing)).visible);
        const shown = plan.show.filter(({ key }) => visible.has(key));
        visibleSets.push(shown.map(({ segment }) => segment).sort((a, b) => a - b));
      }
      expect(visibleSets).toEqual(expected);
    },
    60_000,
  );

  describe.skipIf(TERRAPORT_TOKEN_URL === undefined)("that asks for a token", () => {
    test("a wrong one is told and not repeated; the right one, given by reconnect, lands", async () => {
      const { stream, ready, until, of } = listen({ token: "not-the-right-token" }, TERRAPORT_TOKEN_URL);
      const landing = stream.land(HERE, 20);
      const { link } = await until("link", (event) => event.link.state === "closed");
      expect(link).toMatchObject({ code: "unauthorised", closeCode: 4401 });
      await new Promise((resolve) => setTimeout(resolve, 700));
      expect(of("link").filter((event) => event.link.state === "connecting").length).toBe(1);
      stream.reconnect(TERRAPORT_TOKEN);
      expect((await ready(landing)).visible.length).toBeGreaterThan(0);
    });

    test("the right one opens at once, and none is refused", async () => {
      const { stream, ready } = listen({ token: TERRAPORT_TOKEN ?? "" }, TERRAPORT_TOKEN_URL);
      expect((await ready(stream.land(HERE, 20))).missing).toEqual([]);
      const without = listen({}, TERRAPORT_TOKEN_URL);
      const { link } = await without.until("link", (event) => event.link.state === "closed");
      expect(link).toMatchObject({ code: "unauthorised" });
    });
  });
});
