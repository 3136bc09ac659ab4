"""Attacks by HTTP requests, without a token: floods, and requests that cost more than others.

As in :mod:`attacks.load`, each runs from one address until it is told to stop.
"""

from __future__ import annotations

import contextlib
import socket
import time
from typing import Final

from attacks.strangers import Attack, Going

__all__ = ["REQUEST_ATTACKS", "flood"]

SOCKETS: Final = 32

_HOST: Final = b"Host: 127.0.0.1\r\n\r\n"


def plain_requests(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Ask for a scene without a token, 16 times at once on each of many connections."""
    return flood(port, [f"GET /scenes/{scene} HTTP/1.1\r\n".encode() + _HOST], going, address)


def odd_requests(port: int, scene: str, _token: str, going: Going, address: str) -> int:
    """Ask for everything in the costliest ways: long names and queries, many headers, ranges."""
    path = "/scenes/" + "%F0%9F%A6%8A" * 2000 + "/base.tsg"
    query = "&".join(f"v{number}=%C3%A4" for number in range(1500))
    headers = "".join(f"X-{number}: {number}\r\n" for number in range(1500))
    ranges = "Range: bytes=" + ",".join(f"{number}-{number}" for number in range(8)) + "\r\n"
    requests = [
        f"GET {path} HTTP/1.1\r\n",
        f"GET /scenes/{scene}?{query} HTTP/1.1\r\n",
        f"HEAD /scenes/{scene}/base.tsg HTTP/1.1\r\n{headers}",
        f"GET /scenes/{scene}/segments/1.glb HTTP/1.1\r\n{ranges}",
        f"OPTIONS /scenes/{scene} HTTP/1.1\r\nOrigin: http://x\r\n",
        "GET /healthz HTTP/1.1\r\n",
        "GET /readyz HTTP/1.1\r\n",
        "GET /scenes HTTP/1.1\r\nAuthorization: Bearer " + "x" * 16_000 + "\r\n",
    ]
    return flood(port, [text.encode() + _HOST for text in requests], going, address)


def page_requests(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Ask for the page again and again, and read what comes."""
    return flood(port, [b"GET / HTTP/1.1\r\n" + _HOST], going, address)


def unread_pages(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Ask for the page again and again, and read nothing."""
    return flood(port, [b"GET / HTTP/1.1\r\n" + _HOST], going, address, reads=False)


def short_requests(port: int, _scene: str, _token: str, going: Going, address: str) -> int:
    """Connect, ask whether the service lives, and connect anew."""
    done = 0
    while going():
        with (
            contextlib.suppress(OSError),
            socket.create_connection(("127.0.0.1", port), 1, source_address=(address, 0)) as sock,
        ):
            sock.sendall(b"GET /healthz HTTP/1.1\r\n" + _HOST)
            done += bool(sock.recv(1 << 16))
    return done


REQUEST_ATTACKS: Final[dict[str, Attack]] = {
    "requests": plain_requests,
    "odd requests": odd_requests,
    "page requests": page_requests,
    "unread pages": unread_pages,
    "short requests": short_requests,
}


def flood(
    port: int, requests: list[bytes], going: Going, address: str, *, reads: bool = True
) -> int:
    """Write requests without end on each of many connections; count those that were answered."""
    sockets: list[socket.socket] = []
    left: dict[socket.socket, bytes] = {}
    bundle = b"".join(requests[number % len(requests)] for number in range(16))
    done = 0
    while going():
        if len(sockets) < SOCKETS:
            with contextlib.suppress(OSError):
                sock = socket.create_connection(("127.0.0.1", port), 1, source_address=(address, 0))
                sock.setblocking(False)
                sockets.append(sock)
                left[sock] = bundle
        time.sleep(0.001)
        for sock in list(sockets):
            try:
                with contextlib.suppress(BlockingIOError):
                    while reads:
                        data = sock.recv(1 << 18)
                        done += data.count(b"HTTP/1.1 ")
                        if not data:
                            raise ConnectionError
                with contextlib.suppress(BlockingIOError):
                    left[sock] = left[sock][sock.send(left[sock]) :] or bundle
            except OSError:
                sock.close()
                sockets.remove(sock)
                del left[sock]
    for sock in sockets:
        sock.close()
    return done
