"""Attacks that are said in a line or two: what is sent first, and what is sent again and again.

As in :mod:`attacks.load`, each runs from one address until it is told to stop. Three tables: bytes
of who is not let in (:data:`_ENDLESS`), requests (:data:`_REQUESTS`), and what a client with a
token says (:data:`_CLIENTS`).
"""

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from attacks.peers import BINARY, CONT, PING, frame
from attacks.plans import BURST, WISHES_PER_S
from attacks.requests import flood
from attacks.strangers import Attack, Going, hold, upgrade_request
from parts.drain_client import DrainClient

from terraport_wire import (
    KEY_DTYPE,
    MAX_HAVE,
    MAX_INTEGER,
    MAX_WITHOUT,
    Credit,
    Land,
    Message,
    Pick,
    encode,
)

__all__ = ["TABLE_ATTACKS", "TABLE_CLIENT_ATTACKS", "TABLE_STRANGER_ATTACKS"]

CLIENTS: Final = 8
"""Sessions of one address at once."""

_CONT: Final = frame(CONT, b"x", fin=False)
_BEGIN: Final = frame(BINARY, b"\x81", fin=False)
_CHUNKED: Final = b"POST /scenes HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"
_LONG_BODY: Final = b"POST /scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 9999999999\r\n\r\n"
_BODY: Final = b"POST /scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 16000\r\n\r\n" + bytes(16_000)

_ENDLESS: Final[dict[str, tuple[bytes, bytes]]] = {
    "chunks of a byte": (_CHUNKED, b"1\r\nx\r\n" * 4000),
    "chunk extensions": (_CHUNKED, b"1;" + b"a" * 60_000),
    "trailers without end": (_CHUNKED + b"0\r\n", b"X-Trailer: y\r\n" * 4000),
    "bodies without end": (_LONG_BODY, bytes(1 << 16)),
    "pipelined bodies": (b"", _BODY * 4),
    "headers without end": (b"GET / HTTP/1.1\r\nHost: x\r\n", b"X-Header: y\r\n" * 4000),
    "fragments of a byte": (b"", _BEGIN + _CONT * 4000),
    "pings between fragments": (b"", _BEGIN + (_CONT + frame(PING, b"")) * 2000),
    "compressed frames": (b"", frame(BINARY, b"\x81\xa4type\xa3bye", rsv=4) * 100),
    "hellos of 60 KB": (b"", frame(BINARY, bytes(60_000))),
}  # fmt: skip
"""First bytes, and those that are sent as long as the connection lives. Without first ones: of a
WebSocket, but for "pipelined bodies"."""

_DRAW: Final = random.Random(55)

_REQUESTS: Final[dict[str, tuple[str, ...]]] = {
    "a thousand ranges": tuple(
        f"GET /scenes/SCENE/{name} HTTP/1.1\r\nRange: bytes="
        + ",".join(f"{2 * at}-{2 * at}" for at in range(1000))
        + "\r\n"
        for name in ("base.tsg", "segments/1.glb")
    ),
    "heads": (
        "HEAD /scenes/SCENE/base.tsg HTTP/1.1\r\n",
        "HEAD /scenes/SCENE/segments/1.glb HTTP/1.1\r\n",
        "HEAD / HTTP/1.1\r\n",
    ),
    "guessed tokens": tuple(
        f"GET /scenes HTTP/1.1\r\nAuthorization: Bearer {_DRAW.randbytes(16).hex()}\r\n"
        for _ in range(64)
    ),
    "wrong packs": tuple(
        f"GET /scenes/SCENE/v-{_DRAW.randbytes(8).hex()}/segments.pack HTTP/1.1\r\n"
        f"Range: bytes={at}-{at}\r\n"
        for at in range(64)
    ),
}


_DEEP: Final = b"\x82\xa4type\xa4wave\xa1x" + b"\x91" * 200_000 + b"\x00"
"""A message of an unknown type: lists in lists."""


@dataclass(frozen=True)
class _Client:
    """What one client with a token does."""

    says: Callable[[int], list[Message]] = lambda _turn: []
    """Messages of a turn, counted from 0."""
    frames: bytes = b""
    """Sent each turn, as they stand."""
    credit_bytes: int = 0
    turns_per_s: float = WISHES_PER_S
    burst: int = BURST
    clients: int = CLIENTS
    leaves_after: int = 0
    """Turns; then another comes in its place. 0: stays."""


_KEYS: Final = np.random.default_rng(20).integers(0, 1 << 63, MAX_HAVE).astype(KEY_DTYPE)


def _land(turn: int, radius_m: float = 100.0, **fields: Any) -> Land:
    fields = {"have": _KEYS[:0], "taken_bytes": 0} | fields
    position = (500.0 + turn % 16, 0.0, 500.0)
    return Land(generation=turn + 1, position=position, radius_m=radius_m, **fields)


def _pick(turn: int) -> list[Message]:
    return [
        Pick(request=turn, origin=(100.0 + turn % 800, 50.0, 100.0), direction=(0.3, -1.0, 0.2))
    ]


def _long_pick(turn: int) -> list[Message]:
    """Ask along a ray that enters the boxes of a whole row of segments."""
    origin = (0.0, 0.5, 10.0 * (turn % 80))
    return [Pick(request=turn, origin=origin, direction=(1.0, 1e-4, 1e-3))]


_CLIENTS: Final[dict[str, _Client]] = {
    "hello, and silence": _Client(),
    "all seats": _Client(clients=32),
    "pings of a client": _Client(frames=frame(PING, bytes(125)) * 20),
    "message in single bytes": _Client(
        frames=frame(BINARY, b"", fin=False) + frame(CONT, b"x", fin=False) * 15, turns_per_s=30
    ),
    "credit by the byte": _Client(says=lambda turn: [Credit(bytes=1), _land(turn)], burst=280,
                                  turns_per_s=WISHES_PER_S / 2),
    "credit without bound": _Client(says=lambda _: [Credit(bytes=MAX_INTEGER)] * 8, burst=70,
                                    turns_per_s=WISHES_PER_S / 8),
    "landings with all keys": _Client(says=lambda turn: [_land(turn, have=_KEYS)]),
    "landings without": _Client(says=lambda turn: [_land(turn, without=_KEYS[:MAX_WITHOUT])]),
    "picks": _Client(says=_pick),
    "long picks": _Client(says=_long_pick),
    "comes and goes": _Client(says=lambda turn: [_land(turn, 500.0)], leaves_after=1),
    "deep messages": _Client(frames=frame(BINARY, _DEEP) * 4, turns_per_s=WISHES_PER_S / 4,
                             burst=BURST // 4),
}  # fmt: skip


def _endless(
    first: bytes, again: bytes, port: int, scene: str, _token: str, going: Going, address: str
) -> int:
    begin = first if again.startswith(b"POST") else first or upgrade_request(scene)
    return hold(port, begin, going, address, then=again, again=True)


def _requests(
    heads: tuple[str, ...], port: int, scene: str, _token: str, going: Going, address: str
) -> int:
    host = b"Host: 127.0.0.1\r\n\r\n"
    return flood(
        port, [head.replace("SCENE", scene).encode() + host for head in heads], going, address
    )


def _clients(kind: _Client, port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Have some clients that do so, and another for each that is closed."""
    clients: dict[DrainClient, tuple[int, float]] = {}
    """Each with its turns and when it began."""
    done = 0
    while going():
        if len(clients) < kind.clients:
            with contextlib.suppress(OSError, AssertionError):
                client = DrainClient("127.0.0.1", port, scene, address=address)
                client.hello(credit_bytes=kind.credit_bytes, token=token)
                client.socket.setblocking(False)
                clients[client] = (0, time.monotonic())
        time.sleep(0.002)
        for client, (turns, began_s) in list(clients.items()):
            if turns < kind.burst + kind.turns_per_s * (time.monotonic() - began_s):
                data = kind.frames
                for message in kind.says(turns):
                    raw = encode(message)
                    data += frame(BINARY, raw if isinstance(raw, bytes) else raw.encode())
                clients[client] = (turns + 1, began_s)
                if _exchange(client, data):
                    done += 1
                    if not kind.leaves_after or turns + 1 < kind.leaves_after:
                        continue
            elif _exchange(client, b""):
                continue
            client.close()
            del clients[client]
    for client in clients:
        client.close()
    return done


def _exchange(client: DrainClient, data: bytes) -> bool:
    """Read what came and write; tell whether the service goes on."""
    try:
        with contextlib.suppress(BlockingIOError):
            while client.socket.recv(1 << 16):
                pass
            return False
        while data:
            with contextlib.suppress(BlockingIOError):
                data = data[client.socket.send(data) :]
                continue
            with contextlib.suppress(BlockingIOError):
                if not client.socket.recv(1 << 16):
                    return False
            time.sleep(0.001)
    except OSError:
        return False
    return True


TABLE_STRANGER_ATTACKS: Final[dict[str, Attack]] = {
    **{name: partial(_endless, *row) for name, row in _ENDLESS.items()},
    **{name: partial(_requests, heads) for name, heads in _REQUESTS.items()},
}
"""Of those who are not let in."""

TABLE_CLIENT_ATTACKS: Final[dict[str, Attack]] = {
    name: partial(_clients, kind) for name, kind in _CLIENTS.items()
}

TABLE_ATTACKS: Final[dict[str, Attack]] = {**TABLE_STRANGER_ATTACKS, **TABLE_CLIENT_ATTACKS}
