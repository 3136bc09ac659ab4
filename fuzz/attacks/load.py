"""Attacks on everybody else's time: what one peer can send cheaply and the service pays for.

Each runs until it is told to stop, from an address of its own (127.0.0.2), and returns how often it
did what it does. Numbers of connections and bytes are bounded; ``benchmarks/attack_cost.py`` plays
them beside an honest client.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgpack
from attacks.peers import BINARY, Answers, HangError, HostilePeer, frame
from parts.drain_client import DrainClient

from terraport_wire import Land, Plan

__all__ = ["ATTACKS", "Attack"]

ADDRESS: Final = "127.0.0.2"

MOST_SOCKETS: Final = 3000
"""Held open by one attacker at once."""

UPGRADES_PER_S: Final = 1500.0

BURST: Final = 580
"""Messages that the service takes at once by default, less a few."""

LANDINGS_PER_S: Final = 58.0

_VALUES: Final = [[0] * 16_000] * 64
"""A megabyte of the smallest values."""

Attack = Callable[[int, str, str, Callable[[], bool]], int]
"""Port, scene and token of the service, and whether to go on; returns how often it was done."""


def unknown_type(port: int, scene: str, _token: str, going: Callable[[], bool]) -> int:
    """Send messages of an unknown type, a megabyte of tiny values each, without a hello."""
    return _send(port, scene, frame(BINARY, msgpack.packb({"type": "wave", "x": _VALUES})), going)


def unknown_type_last(port: int, scene: str, _token: str, going: Callable[[], bool]) -> int:
    """Send the same with the type behind the values."""
    return _send(port, scene, frame(BINARY, msgpack.packb({"x": _VALUES, "type": "wave"})), going)


def known_type(port: int, scene: str, _token: str, going: Callable[[], bool]) -> int:
    """Send aims with a megabyte of tiny values in a field that nobody knows."""
    message = {"type": "aim", "generation": 1, "x": _VALUES}
    return _send(port, scene, frame(BINARY, msgpack.packb(message)), going)


def empty_frames(port: int, scene: str, _token: str, going: Callable[[], bool]) -> int:
    """Send frames without content, 40,000 in one piece."""
    return _send(port, scene, frame(BINARY, b"") * 40_000, going)


def upgrades(port: int, scene: str, _token: str, going: Callable[[], bool]) -> int:
    """Become a WebSocket again and again, and never read, answer or close."""
    request = (
        f"GET /scenes/{scene}/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: terraport.v1.msgpack\r\n\r\n"
    ).encode()
    open_sockets: deque[socket.socket] = deque()
    done, began_s = 0, time.monotonic()
    while going():
        if done > UPGRADES_PER_S * (time.monotonic() - began_s):
            time.sleep(0.001)
            continue
        with contextlib.suppress(OSError):
            sock = socket.create_connection(("127.0.0.1", port), 5, source_address=(ADDRESS, 0))
            sock.sendall(request)
            open_sockets.append(sock)
        done += 1
        while len(open_sockets) > MOST_SOCKETS:
            open_sockets.popleft().close()
    for sock in open_sockets:
        sock.close()
    return done


def wide_landings(port: int, scene: str, token: str, going: Callable[[], bool]) -> int:
    """Land with the largest radius and release factor, as often as one client may."""
    done = 0
    while going():
        with contextlib.suppress(OSError, AssertionError):
            client = DrainClient("127.0.0.1", port, scene, address=ADDRESS)
            try:
                client.hello(credit_bytes=0, token=token, release_factor=4.0)
                left, began_s = BURST, time.monotonic()
                while going():
                    count = min(16, left + int(LANDINGS_PER_S * (time.monotonic() - began_s)))
                    if count > 0:
                        _land(client, count)
                        left -= count
                        done += count
                    else:
                        time.sleep(1 / LANDINGS_PER_S)
            finally:
                client.close()
    return done


ATTACKS: Final[dict[str, Attack]] = {
    "unknown type": unknown_type,
    "unknown type, last": unknown_type_last,
    "known type": known_type,
    "empty frames": empty_frames,
    "upgrades": upgrades,
    "landings at factor 4": wide_landings,
}


def _send(port: int, scene: str, data: bytes, going: Callable[[], bool]) -> int:
    """Send the same bytes as long as nothing is answered, then connect again at once."""
    done = 0
    while going():
        with contextlib.suppress(OSError, HangError), HostilePeer(port, address=ADDRESS) as peer:
            peer.handshake(scene, Answers())
            while going() and peer.write(data):
                done += 1
                if select.select([peer.socket], [], [], 0.0)[0]:
                    break
    return done


def _land(client: DrainClient, count: int) -> None:
    """Land so many times in one write, and read the plans."""
    first = client.generation + 1
    client.generation += count
    client.send(
        *(
            Land(generation=first + at, position=(500.0 + 10 * at, 0.0, 500.0), radius_m=500.0)
            for at in range(count)
        )
    )
    while count:
        count -= isinstance(client.message(), Plan)
