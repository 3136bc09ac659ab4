"""What clients do to a deployment while docker/verify.py looks on: landings by the Python SDK."""

from __future__ import annotations

import asyncio
import json
import random
import signal
from collections.abc import Callable
from typing import Any

import httpx
from commands import say
from containers import Container
from websockets.asyncio.client import connect as connect_websocket

import terraport
from terraport_wire import SUBPROTOCOL, Budgets, Hello, encode

__all__ = ["check_groups", "check_landings", "check_restart", "check_survivor"]

CENTRE = (30.0, 1.0, 30.0)
SEGMENTS = 36


def _payloads() -> list[bytes]:
    """Make what the scene `big` holds, from its formula."""
    from server.grid_scene import SCALES, SIDE, STEP_M, shuffled, tile_mesh

    from terraport_payload import encode_segment

    return [
        encode_segment(shuffled(tile_mesh(row, column, 80)), step_m=STEP_M, scales=SCALES)
        for row in range(SIDE)
        for column in range(SIDE)
    ]


def _opened(server: Container) -> list[dict[str, Any]]:
    """Sessions that a replica has opened, from its log of JSON lines."""
    lines = [json.loads(line) for line in server.log.splitlines() if line.startswith("{")]
    return [line for line in lines if line["event"] == "session opened"]


async def check_landings(url: str, token: str, servers: list[Container]) -> None:
    """Eight clients, each with the whole scene: byte-equal, spread over the replicas."""
    payloads = _payloads()

    async def client() -> None:
        async with terraport.connect(f"{url}/scenes/big", token) as session:
            landing = await session.land(CENTRE, radius_m=100.0)
            segments = await landing.ready(30)
            assert {segment.id: segment.payload for segment in segments} == dict(
                enumerate(payloads)
            )
            assert await session.base() is not None

    await asyncio.gather(*(client() for _ in range(8)))
    opened = [_opened(server) for server in servers]
    assert all(opened), [len(sessions) for sessions in opened]
    # A replica sees who a client is, not the proxy.
    gateway = servers[0].network.gateway
    assert {line["client"] for sessions in opened for line in sessions} == {gateway}
    say(f"ok: 8 landings over wss, byte-equal; sessions by replica: {list(map(len, opened))}")


async def check_groups(url: str, token: str, servers: list[Container]) -> None:
    """All connections of one group reach one replica, whatever the name; groups spread."""
    address = url.replace("https", "wss") + "/scenes/big/stream?group="
    hello = encode(Hello(client="verify", budgets=Budgets(), credit_bytes=0))
    homes = set()
    for name in ("north", "south", "east", "west", "up", "down"):
        before = [len(_opened(server)) for server in servers]
        for _ in range(4):
            async with connect_websocket(
                address + name,
                subprotocols=[SUBPROTOCOL],
                additional_headers={
                    "Authorization": f"Bearer {token}",
                    "X-Terraport-Group": "forged",
                    "X-Forwarded-For": "203.0.113.9",
                },
            ) as socket:
                await socket.send(hello)  # a session counts from its welcome on
                await socket.recv()
        await asyncio.sleep(0.1)
        grown = [
            len(_opened(server)) - count for server, count in zip(servers, before, strict=True)
        ]
        assert sorted(grown) == [0] * (len(servers) - 1) + [4], (name, grown)
        homes.add(grown.index(4))
    seen = {line["client"] for server in servers for line in _opened(server)}
    assert seen == {servers[0].network.gateway}, f"a client chose its own address: {seen}"
    say(f"ok: each of 6 groups meets in one replica; {len(homes)} replicas used")


async def _land_until(url: str, token: str, number: int, over: asyncio.Event) -> tuple[int, int]:
    """Land again and again; return landings and connections."""
    chance = random.Random(number)
    payloads = _payloads()
    landings = 0
    async with terraport.connect(f"{url}/scenes/big", token, credit_bytes=1_000_000) as session:
        while not over.is_set():
            position = (chance.uniform(0, 60), 1.0, chance.uniform(0, 60))
            landing = await session.land(position, radius_m=chance.uniform(5, 25))
            segments = await landing.ready(40)
            assert all(segment.payload == payloads[segment.id] for segment in segments)
            landings += 1
            await asyncio.sleep(0.1)
        assert session.stats.repeated_bytes == 0
        assert session.stats.rejected == 0
        return landings, session.stats.connections


async def check_restart(
    url: str, token: str, servers: list[Container], is_ready: Callable[[Container], bool]
) -> None:
    """Restart all replicas, one after the other, under clients that land all the time."""
    over = asyncio.Event()
    clients = [asyncio.create_task(_land_until(url, token, number, over)) for number in range(4)]
    await asyncio.sleep(0.5)

    async def restart() -> None:
        for server in servers:
            code = await asyncio.to_thread(server.end)
            assert code == 0, code
            server.start()
            await _until_ready(server, is_ready)
            await asyncio.sleep(3.0)  # the proxy looks the name up each second

    restarting = asyncio.create_task(restart())
    done, _ = await asyncio.wait([restarting, *clients], return_when=asyncio.FIRST_COMPLETED)
    for task in done:
        task.result()
    over.set()
    results = await asyncio.gather(*clients)
    assert all(connections >= 2 for _, connections in results), results
    total = sum(landings for landings, _ in results)
    say(f"ok: all replicas restarted, one by one: {total} landings, none failed or repeated")


async def check_survivor(
    url: str, token: str, servers: list[Container], is_ready: Callable[[Container], bool]
) -> None:
    """Kill a replica in the middle of a landing: another one finishes it."""
    payloads = _payloads()
    before = [len(_opened(server)) for server in servers]
    async with terraport.connect(f"{url}/scenes/big", token, credit_bytes=400_000) as session:
        landing = await session.land(CENTRE, radius_m=100.0)
        seen = 0
        async for _ in landing:
            seen += 1
            if seen == 8:
                grown = [
                    len(_opened(server)) - old for server, old in zip(servers, before, strict=True)
                ]
                victim = servers[grown.index(1)]
                await asyncio.to_thread(victim.end, signal.SIGKILL)
        received = {segment.id: segment.payload for segment in landing.segments}
        assert seen == SEGMENTS
        assert received == dict(enumerate(payloads))
        assert session.stats.connections == 2, session.stats
        assert session.stats.repeated_bytes == 0
    say("ok: a replica killed in mid-landing; the SDK resumed on another, nothing sent twice")
    victim.start()
    await _until_ready(victim, is_ready)


async def _until_ready(server: Container, is_ready: Callable[[Container], bool]) -> None:
    async with asyncio.timeout(40):
        while True:
            try:
                if is_ready(server):
                    return
            except (httpx.TransportError, OSError):
                pass  # not up yet
            await asyncio.sleep(0.1)
