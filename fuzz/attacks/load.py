"""Attacks on everybody else's time: what one peer can send cheaply and the service pays for.

Each runs until it is told to stop, from one address (127.0.0.2 and on), and returns how often it
did what it does. Numbers of connections and bytes are bounded; ``benchmarks/soak.py --attacks``
plays them beside an honest client, from one address or from ten.

Here: messages, frames and upgrades. Beside it plans (:mod:`attacks.plans`), those who are never let
in (:mod:`attacks.strangers`), HTTP requests (:mod:`attacks.requests`), seats of groups
(:mod:`attacks.seats`), and what is said in a line (:mod:`attacks.table`).
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from typing import Final

import msgpack
from attacks.holders import HOLDER_ATTACKS
from attacks.peers import BINARY, Answers, HangError, HostilePeer, frame
from attacks.plans import PLAN_ATTACKS
from attacks.requests import REQUEST_ATTACKS
from attacks.seats import SEAT_ATTACKS
from attacks.strangers import STRANGER_ATTACKS, Attack, Going, upgrade_request
from attacks.table import TABLE_ATTACKS

__all__ = ["ATTACKS"]

MOST_SOCKETS: Final = 3000
"""Held open by one attacker at once."""

UPGRADES_PER_S: Final = 1500.0

_VALUES: Final = [[0] * 16_000] * 64
"""A megabyte of the smallest values."""


def unknown_type(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Send messages of an unknown type, a megabyte of tiny values each, without a hello."""
    data = frame(BINARY, msgpack.packb({"type": "wave", "x": _VALUES}))
    return _send(port, scene, data, going, address)


def unknown_type_last(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Send the same with the type behind the values."""
    data = frame(BINARY, msgpack.packb({"x": _VALUES, "type": "wave"}))
    return _send(port, scene, data, going, address)


def known_type(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Send landings with a megabyte of tiny values in a field that nobody knows."""
    message = {"type": "land", "generation": 1, "x": _VALUES}
    return _send(port, scene, frame(BINARY, msgpack.packb(message)), going, address)


def empty_frames(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Send frames without content, 40,000 in one piece."""
    return _send(port, scene, frame(BINARY, b"") * 40_000, going, address)


def upgrades(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket again and again, and never read, answer or close."""
    request = upgrade_request(scene)
    open_sockets: deque[socket.socket] = deque()
    done, began_s = 0, time.monotonic()
    while going():
        if done > UPGRADES_PER_S * (time.monotonic() - began_s):
            time.sleep(0.001)
            continue
        with contextlib.suppress(OSError):
            sock = socket.create_connection(("127.0.0.1", port), 5, source_address=(address, 0))
            sock.sendall(request)
            open_sockets.append(sock)
        done += 1
        while len(open_sockets) > MOST_SOCKETS:
            open_sockets.popleft().close()
    for sock in open_sockets:
        sock.close()
    return done


ATTACKS: Final[dict[str, Attack]] = {
    "unknown type": unknown_type,
    "unknown type, last": unknown_type_last,
    "known type": known_type,
    "empty frames": empty_frames,
    "upgrades": upgrades,
    **PLAN_ATTACKS,
    **STRANGER_ATTACKS,
    **REQUEST_ATTACKS,
    **SEAT_ATTACKS,
    **TABLE_ATTACKS,
    **HOLDER_ATTACKS,
}


def _send(port: int, scene: str, data: bytes, going: Going, address: str) -> int:
    """Send the same bytes as long as nothing is answered, then connect again at once."""
    done = 0
    while going():
        with contextlib.suppress(OSError, HangError), HostilePeer(port, address=address) as peer:
            peer.handshake(scene, Answers())
            while going() and peer.write(data):
                done += 1
                if select.select([peer.socket], [], [], 0.0)[0]:
                    break
    return done
