"""A thousand clients at once: each is served or told why not, and nobody is left waiting."""

from __future__ import annotations

import asyncio
import resource
import time
from collections import Counter
from pathlib import Path

import pytest
from eventually import eventually
from faults.service import Service
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, make_hello
from websockets.exceptions import ConnectionClosed

from terraport_wire import SUBPROTOCOL, Direction, Ready, Welcome, decode, encode

CLIENTS = 1000


def request(port: int) -> bytes:
    return (
        f"GET /scenes/grid/stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n"
    ).encode()


async def knock(
    port: int, together: asyncio.Event, answered: asyncio.Semaphore, go_home: asyncio.Event
) -> str:
    """One client; returns how it was answered. Whoever is served stays until all were answered."""
    await together.wait()
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(request(port))
        status = (await reader.readuntil(b"\r\n\r\n")).split()[1].decode()
        if status != "101":
            answered.release()
            return status
        hello = encode(make_hello())
        size = len(hello).to_bytes(2, "big")
        head = bytes([0x82, 0x80 | len(hello)]) if len(hello) < 126 else b"\x82\xfe" + size
        writer.write(head + bytes(4) + hello)
        first, second = await reader.readexactly(2)
        length = second & 0x7F
        if length == 126:
            length = int.from_bytes(await reader.readexactly(2), "big")
        data = await reader.readexactly(length)
        answered.release()
        if first == 0x88:
            return str(int.from_bytes(data[:2], "big"))
        message = decode(data, Direction.SERVER_TO_CLIENT)
        if isinstance(message, Welcome):
            await go_home.wait()
            return "welcome"
        return str(getattr(message, "code", message))
    finally:
        writer.transport.abort()


def lands(url: str) -> bool:
    """Land as a client does that comes after them; False where there is no room yet."""
    with PlainClient(url) as client:
        try:
            client.send(make_hello())
            if not isinstance(client.receive(), Welcome):
                return False
        except ConnectionClosed:
            return False
        client.land(1, (30.0, 1.0, 30.0), 15.0)
        client.until(Ready)
        return True


@pytest.mark.parametrize("room", [64, 1000])
def test_a_thousand_at_once(tmp_path: Path, room: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 2 * CLIENTS:
        pytest.skip(f"{hard} open files are allowed, {2 * CLIENTS} are needed")
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    write_grid_scene(tmp_path / "scenes" / "grid", cells=2)

    async def work(port: int) -> tuple[Counter[str], float]:
        together, go_home = asyncio.Event(), asyncio.Event()
        answered = asyncio.Semaphore(0)
        tasks = [
            asyncio.create_task(knock(port, together, answered, go_home)) for _ in range(CLIENTS)
        ]
        await asyncio.sleep(0)
        began_s = time.monotonic()
        together.set()
        async with asyncio.timeout(60):
            for _ in range(CLIENTS):
                await answered.acquire()
        took_s = time.monotonic() - began_s
        go_home.set()
        return Counter(await asyncio.gather(*tasks)), took_s

    try:
        with Service(tmp_path / "scenes", max_sessions=room, max_sessions_per_ip=room) as service:
            answered, took_s = asyncio.run(work(service.port))
            assert answered["welcome"] == room, answered
            assert answered["too_many"] == CLIENTS - room, answered
            assert took_s < 30
            assert service.alive
            eventually(lambda: lands(f"{service.url}/scenes/grid"), 20)  # the others are leaving
            assert " error " not in service.log
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
