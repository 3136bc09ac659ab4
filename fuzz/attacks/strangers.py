"""Attacks of those who are never let in: what a peer without a token can hold, and make happen.

As in :mod:`attacks.load`, each runs from one address until it is told to stop.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgpack
from attacks.peers import BINARY, CLOSE, PING, frame

__all__ = ["STRANGER_ATTACKS", "Attack", "Going", "hold", "upgrade_request"]

Going = Callable[[], bool]
"""Whether to go on."""

Attack = Callable[[int, str, str, Going, str], int]
"""Port, scene and token of the service, whether to go on, address to come from; returns how often
it was done."""

SOCKETS: Final = 150
"""Held open from one address: a few, beside the service's descriptors."""

CYCLES_PER_S: Final = 500.0

_DIAL_S: Final = 0.25

_HALF: Final = frame(BINARY, bytes(1_000_000), declared=1_048_000)
"""A message of which the end never comes."""

_MANY_PIECES: Final = frame(BINARY, b"\x80", fin=False) + frame(0, b"", fin=False) * 200

_PINGS: Final = frame(PING, b"x" * 32) * 400


def upgrade_request(scene: str) -> bytes:
    """Write the request that becomes a WebSocket of a scene's stream."""
    return (
        f"GET /scenes/{scene}/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: terraport.v2.msgpack\r\n\r\n"
    ).encode()


def silent_connections(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Connect and say nothing; again for each one that is closed."""
    return hold(port, b"", going, address)


def slow_headers(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Say the headers of a request a few bytes at a time."""
    return hold(port, b"GET / HTTP/1.1\r\nHost: 127", going, address, drip=b"x")


def silent_upgrades(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket and say nothing; again for each one that is closed."""
    return hold(port, upgrade_request(scene), going, address)


def pings_first(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket, and send pings in place of a hello."""
    return hold(port, upgrade_request(scene), going, address, then=_PINGS, again=True)


def pieces_first(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket, and send a message in empty fragments that never ends."""
    return hold(port, upgrade_request(scene), going, address, then=_MANY_PIECES, again=True)


def half_messages(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket, and send nearly all of a message of a megabyte."""
    return hold(port, upgrade_request(scene), going, address, then=_HALF)


def wrong_hellos(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Say a hello with a wrong token, read the refusal, and come again at once."""
    hello = {"type": "hello", "protocol": [1, 0], "client": "x", "token": "y" * 40}
    hello |= {"encoding": "segment-2", "budgets": {}, "credit_bytes": 0}
    data = upgrade_request(scene) + frame(BINARY, msgpack.packb(hello))
    return _cycle(port, data, going, address)


def no_upgrades(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Ask for an upgrade that the library refuses, and come again at once."""
    data = upgrade_request(scene).replace(b"Version: 13", b"Version: 7")
    return _cycle(port, data, going, address)


def closes_first(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Become a WebSocket and close it, and come again at once."""
    return _cycle(port, upgrade_request(scene) + frame(CLOSE, b"\x03\xe8"), going, address)


def other_protocols(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Begin with HTTP/2, and come again at once."""
    return _cycle(port, b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(9), going, address)


STRANGER_ATTACKS: Final[dict[str, Attack]] = {
    "silent connections": silent_connections,
    "slow headers": slow_headers,
    "silent upgrades": silent_upgrades,
    "pings first": pings_first,
    "pieces first": pieces_first,
    "half messages": half_messages,
    "wrong hellos": wrong_hellos,
    "no upgrades": no_upgrades,
    "closes first": closes_first,
    "other protocols": other_protocols,
}


def hold(
    port: int,
    first: bytes,
    going: Going,
    address: str,
    *,
    then: bytes = b"",
    again: bool = False,
    drip: bytes = b"",
) -> int:
    """Hold as many connections as may be, and open another for each that is closed."""
    held: deque[tuple[socket.socket, bytearray]] = deque()
    done, dripped_s = 0, time.monotonic()
    while going():
        if len(held) < SOCKETS:
            with contextlib.suppress(OSError):
                sock = socket.create_connection(
                    ("127.0.0.1", port), _DIAL_S, source_address=(address, 0)
                )
                sock.setblocking(False)
                held.append((sock, bytearray(first + then)))
                done += 1
        else:
            time.sleep(0.001)
        drips = time.monotonic() > dripped_s + 1.0
        if drips:
            dripped_s = time.monotonic()
        for _ in range(min(len(held), 16 if not drips else len(held))):
            sock, left = held.popleft()
            if _is_alive(sock, left, then if again else drip if drips else b""):
                held.append((sock, left))
            else:
                sock.close()
    for sock, _ in held:
        sock.close()
    return done


def _is_alive(sock: socket.socket, left: bytearray, more: bytes) -> bool:
    """Read what came, write what is left, add more; tell whether the service goes on."""
    try:
        with contextlib.suppress(BlockingIOError):
            while sock.recv(1 << 16):
                pass
            return False
        left += b"" if left else more
        with contextlib.suppress(BlockingIOError):
            if left:
                del left[: sock.send(left)]
    except OSError:
        return False
    return True


def _cycle(port: int, data: bytes, going: Going, address: str) -> int:
    """Connect, send, read to the end, and again."""
    done, began_s = 0, time.monotonic()
    while going():
        if done > CYCLES_PER_S * (time.monotonic() - began_s):
            time.sleep(0.001)
            continue
        done += 1
        with (
            contextlib.suppress(OSError),
            socket.create_connection(("127.0.0.1", port), 1, source_address=(address, 0)) as sock,
        ):
            sock.sendall(data)
            answer = b""
            while more := sock.recv(1 << 16):
                answer += more
                if b"\x88" in answer[-64:] or not answer.startswith(b"HTTP/1.1 101"):
                    break  # the close frame, or a plain refusal
    return done
