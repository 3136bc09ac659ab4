"""How evenly connections fall on worker processes: one inherited socket, or SO_REUSEPORT each.

::

    python benchmarks/accept_balance.py            # 20 s
    python benchmarks/accept_balance.py --smoke    # one row

Workers are uvloop processes that accept and spend a millisecond on each connection, as a handshake
does. Clients come one after the other ("trickle", 3 ms apart) or all at once ("burst"). Reported:
connections of the busiest worker over its fair share, median and maximum of 20 rounds: 1 is even,
and the number of workers is all on one. Why it is asked: docs/decisions/0019.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import socket
import statistics
import time
from collections import Counter

import uvloop


def listener(port: int, *, share_port: bool) -> socket.socket:
    """Listen on loopback without blocking; `share_port` is SO_REUSEPORT."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if share_port:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    sock.bind(("127.0.0.1", port))
    sock.listen(2048)
    sock.setblocking(False)
    return sock


def serve(own: socket.socket, number: int) -> None:
    """Accept until killed; tell each client who it got."""

    class Greeter(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            transport.write(bytes([number]))
            time.sleep(0.001)

    async def work() -> None:
        loop = asyncio.get_running_loop()
        await loop.create_server(Greeter, sock=own, backlog=2048)
        await asyncio.sleep(120)

    uvloop.run(work())


async def rounds(port: int, workers: int, clients: int, *, burst: bool, count: int) -> list[float]:
    """Connect, count, close; the busiest worker's share of each round."""
    shares = []
    for _ in range(count):
        open_writers: list[asyncio.StreamWriter] = []

        async def connect(writers: list[asyncio.StreamWriter] = open_writers) -> int:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writers.append(writer)
            return (await reader.readexactly(1))[0]

        if burst:
            got = await asyncio.gather(*(connect() for _ in range(clients)))
        else:
            got = []
            for _ in range(clients):
                got.append(await connect())
                await asyncio.sleep(0.003)
        shares.append(max(Counter(got).values()) * workers / clients)
        for writer in open_writers:
            writer.close()
        await asyncio.sleep(0.02)
    return shares


def measure(way: str, workers: int, clients: int, *, burst: bool, count: int) -> dict[str, object]:
    """Start workers, connect to them, end them."""
    if way == "one socket":
        sockets = [listener(0, share_port=False)] * workers
    else:
        first = listener(0, share_port=True)
        port = first.getsockname()[1]
        sockets = [first, *(listener(port, share_port=True) for _ in range(workers - 1))]
    pids = []
    for number in range(workers):
        pid = os.fork()
        if pid == 0:
            serve(sockets[number], number)
            os._exit(0)
        pids.append(pid)
    try:
        time.sleep(0.5)
        port = sockets[0].getsockname()[1]
        shares = asyncio.run(rounds(port, workers, clients, burst=burst, count=count))
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        for sock in set(sockets):
            sock.close()
    return {
        "way": way,
        "workers": workers,
        "clients": clients,
        "arrive": "burst" if burst else "trickle",
        "busiest_over_fair": {"median": round(statistics.median(shares), 2), "max": max(shares)},
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true", help="one row")
    smoke = parser.parse_args().smoke
    for workers in (2,) if smoke else (2, 4):
        for clients in (8,) if smoke else (8, 32, 128):
            for burst in (False, True):
                for way in ("one socket", "SO_REUSEPORT"):
                    count = 2 if smoke else 20
                    row = measure(way, workers, clients, burst=burst, count=count)
                    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
