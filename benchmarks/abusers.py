"""Measure an honest client while ten token holders abuse the service, behind compose's proxy.

Caddy runs with docker/caddy/Caddyfile (TLS by its own CA), the service behind it on 127.0.0.1:8080,
each as a process; every client comes from one address with a token of its own, over wss. Ten
abusers: wide landings, wide prefetches and picks as fast as the rate allows, groups that gather all
the time, clients that land on everything and never read, messages of which half is sent. The honest
client lands at random places; the result is the 99th percentile of the time from land to
ready with abusers, divided by that of the idle service, in turns of one run.

    python benchmarks/abusers.py --scene data/sample_scene        about two minutes
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import secrets
import shutil
import ssl
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from parts.service_process import ServiceProcess
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from terraport_wire import (
    SUBPROTOCOL,
    Budgets,
    Credit,
    Direction,
    Error,
    Gather,
    Hello,
    Join,
    Land,
    Message,
    Pick,
    Prefetch,
    Ready,
    decode,
    encode,
    is_payload,
)

ROOT = Path(__file__).resolve().parents[1]
PORT = 8443
WISHES_PER_S = 58.0
NO_KEYS = np.zeros(0, "<u8")


def anyone() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


async def join_service(scene: str, token: str, credit_bytes: int) -> ClientConnection:
    socket = await connect(
        f"wss://localhost:{PORT}/scenes/{scene}/stream",
        subprotocols=[Subprotocol(SUBPROTOCOL)],
        additional_headers={"Authorization": f"Bearer {token}"},
        compression=None,
        max_size=None,
        ssl=anyone(),
    )
    await socket.send(encode(Hello(client="t", budgets=Budgets(), credit_bytes=credit_bytes)))
    return socket


def place(
    kind: Any, generation: int, centre: Any, radius_m: float, taken_bytes: int = 0
) -> Message:
    return kind(
        generation=generation,
        position=tuple(map(float, centre)),
        radius_m=radius_m,
        have=NO_KEYS,
        taken_bytes=taken_bytes,
    )


async def wish(scene: str, token: str, kind: Any) -> None:
    """Ask for the widest ball as fast as the rate allows; credit is zero, so plans are all."""
    socket = await join_service(scene, token, 0)
    for generation in range(1 << 30):
        await socket.send(encode(place(kind, generation, (generation % 9, 0, 0), 500.0)))
        with suppress(TimeoutError):
            await asyncio.wait_for(socket.recv(), 1 / WISHES_PER_S)
        await asyncio.sleep(1 / WISHES_PER_S)


async def pick(scene: str, token: str) -> None:
    socket = await join_service(scene, token, 0)
    draw = np.random.default_rng(5)
    for request in range(1 << 30):
        x, z = draw.uniform(-40, 40, 2).tolist()
        await socket.send(
            encode(Pick(request=request, origin=(x, 30.0, z), direction=(1.0, -0.05, 0)))
        )
        with suppress(TimeoutError):
            await asyncio.wait_for(socket.recv(), 1 / WISHES_PER_S)
        await asyncio.sleep(1 / WISHES_PER_S)


async def gather(scene: str, token: str) -> None:
    socket = await join_service(scene, token, 0)
    await socket.send(encode(Join(request=0, group="pit", role="guide")))
    for request in range(1, 1 << 30):
        await socket.send(encode(Gather(request=request, position=(0, 0, 0), radius_m=500.0)))
        with suppress(TimeoutError):
            await asyncio.wait_for(socket.recv(), 1 / WISHES_PER_S)
        await asyncio.sleep(1 / WISHES_PER_S)


async def stall(scene: str, token: str) -> None:
    """Land on everything with much credit and never read; eight connections."""
    sockets = [await join_service(scene, token, 616 << 20) for _ in range(8)]
    for socket in sockets:
        socket.transport.pause_reading()
    for generation in range(1 << 30):
        for socket in sockets:
            await asyncio.wait_for(
                socket.send(encode(place(Land, generation, (0, 0, 0), 500.0))), 5
            )
        await asyncio.sleep(0.5)


async def half(scene: str, token: str) -> None:
    """Send half of a message of 1 MB, a few bytes a second."""
    socket = await join_service(scene, token, 0)
    socket.transport.write(struct.pack("!BBQ4s", 0x82, 0xFF, 500_000, b"abcd"))
    while True:
        socket.transport.write(secrets.token_bytes(500))
        await asyncio.sleep(0.05)


ABUSERS: list[Callable[[str, str], Awaitable[None]]] = [
    lambda scene, token: wish(scene, token, Land),
    lambda scene, token: wish(scene, token, Land),
    lambda scene, token: wish(scene, token, Prefetch),
    lambda scene, token: wish(scene, token, Prefetch),
    pick,
    pick,
    gather,
    stall,
    stall,
    half,
]


def abuse(number: int, scene: str, token: str) -> None:
    """Run one abuser, again and again: the service may close it."""

    async def run() -> None:
        while True:
            with suppress(WebSocketException, OSError, TimeoutError):
                await ABUSERS[number](scene, token)
            await asyncio.sleep(0.05)

    asyncio.run(run())


async def land_honestly(scene: str, token: str, landings: int) -> tuple[list[float], int]:
    """Land, wait for ready, rest; return seconds to ready, and failures."""
    draw = np.random.default_rng(1)
    seconds, failed, taken_bytes, used_bytes = [], 0, 0, 0
    socket = await join_service(scene, token, 16 << 20)
    await socket.recv()
    for generation in range(1, landings + 1):
        x, z = draw.uniform(-15, 15, 2)
        began_s = time.perf_counter()
        await socket.send(
            encode(place(Land, generation, (x, 0, z), draw.uniform(5, 15), taken_bytes))
        )
        try:
            async with asyncio.timeout(10):
                while True:
                    data = await socket.recv()
                    if is_payload(data):
                        taken_bytes += len(data) - 24
                        used_bytes += len(data) - 24
                        continue
                    message = decode(data, Direction.SERVER_TO_CLIENT)
                    if isinstance(message, Error):
                        print("refused:", message.code, message.message, file=sys.stderr)
                        failed += 1
                        break
                    if isinstance(message, Ready) and message.generation == generation:
                        seconds.append(time.perf_counter() - began_s)
                        break
        except (TimeoutError, WebSocketException) as error:
            print(f"landing {generation}: {error!r}", file=sys.stderr)
            failed += 1
            socket = await join_service(scene, token, 16 << 20)
            taken_bytes = 0
        await socket.send(encode(Credit(bytes=max(used_bytes, 1))))
        used_bytes = 0
        await asyncio.sleep(0.1)
    await socket.close()
    return seconds, failed


def figures(seconds: list[float], failed: int) -> dict[str, float]:
    p50, p99 = np.quantile(seconds, [0.5, 0.99]) * 1000
    return {"landings": len(seconds), "failed": failed, "p50_ms": p50, "p99_ms": p99}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scene", type=Path, default=ROOT / "data" / "sample_scene")
    parser.add_argument("--landings", type=int, default=200, help="of each turn")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    rounds, landings = (1, 5) if arguments.smoke else (arguments.rounds, arguments.landings)
    if shutil.which("caddy") is None:
        print("skipped: got no caddy, expected Debian's package of that name")
        return 0
    with tempfile.TemporaryDirectory(prefix="abusers-") as folder:
        work = Path(folder)
        shutil.copytree(arguments.scene, work / "scenes" / "scene")
        tokens = [secrets.token_urlsafe(24) for _ in range(len(ABUSERS) + 1)]
        lines = [f"holder-{number} {token}" for number, token in enumerate(tokens)]
        (work / "tokens").write_text("\n".join(lines) + "\n")
        environment = {
            **os.environ,
            "TERRAPORT_DOMAIN": f"localhost:{PORT}",
            "TERRAPORT_SERVICE": "localhost",
            "XDG_DATA_HOME": folder,
            "XDG_CONFIG_HOME": folder,
        }
        proxy_log = (work / "caddy.log").open("wb")
        caddy = ["caddy", "run", "--config", str(ROOT / "docker/caddy/Caddyfile"),
                 "--adapter", "caddyfile"]  # fmt: skip
        proxy = subprocess.Popen(caddy, env=environment, stdout=proxy_log, stderr=proxy_log)
        try:
            with ServiceProcess(
                work / "scenes",
                port=8080,
                tokens_file=work / "tokens",
                forwarded_allow_ips="127.0.0.1",
                allowed_hosts=json.dumps(["localhost"]),
            ):
                time.sleep(1)
                rows = [turn(tokens, landings) for _ in range(rounds)]
        finally:
            proxy.terminate()
            proxy.wait(10)
    print(
        "| round | idle p50 ms | idle p99 ms | abused p50 ms | abused p99 ms | p99 ratio | failed |"
    )
    print("| -- | -- | -- | -- | -- | -- | -- |")
    for number, (idle, abused) in enumerate(rows, 1):
        ratio = abused["p99_ms"] / idle["p99_ms"]
        print(
            f"| {number} | {idle['p50_ms']:.1f} | {idle['p99_ms']:.1f} | {abused['p50_ms']:.1f} "
            f"| {abused['p99_ms']:.1f} | {ratio:.2f} | {idle['failed'] + abused['failed']:.0f} |"
        )
    return int(any(idle["failed"] + abused["failed"] for idle, abused in rows))


def turn(tokens: list[str], landings: int) -> tuple[dict[str, float], dict[str, float]]:
    """Land on the idle service, then while the abusers run."""
    idle = figures(*asyncio.run(land_honestly("scene", tokens[-1], landings)))
    context = multiprocessing.get_context("spawn")
    abusers = [
        context.Process(target=abuse, args=(number, "scene", tokens[number]), daemon=True)
        for number in range(len(ABUSERS))
    ]
    for process in abusers:
        process.start()
    time.sleep(5)
    try:
        abused = figures(*asyncio.run(land_honestly("scene", tokens[-1], landings)))
    finally:
        for process in abusers:
            process.kill()
            process.join()
    time.sleep(2)
    return idle, abused


if __name__ == "__main__":
    sys.exit(main())
