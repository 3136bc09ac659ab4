"""Many clients in one process that drain what they are sent: bytes in, nothing parsed.

One thread and a selector, so that sixty-four clients cost one core of the machine at most and the
service has the other.
"""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable

__all__ = ["drain_all", "drain_paced"]

_PIECE = 1 << 18
_TICK_S = 0.02


def drain_all(
    clients: list[socket.socket], left: list[int], until: Callable[[], bool] = lambda: False
) -> float:
    """Read until every client has its bytes.

    Parameters
    ----------
    clients
        Connected.
    left
        Bytes that each is to receive; counted down in place.
    until
        Ends it sooner.

    Returns
    -------
    float
        Fairness: bytes of the slowest client over bytes of the fastest when the fastest was done.
    """
    buffer = bytearray(_PIECE)
    totals = list(left)
    fairness = 0.0
    with selectors.DefaultSelector() as selector:
        for number, client in enumerate(clients):
            selector.register(client, selectors.EVENT_READ, number)
        while selector.get_map() and not until():
            for key, _ in selector.select(60):
                number = key.data
                got = clients[number].recv_into(buffer, min(_PIECE, left[number]))
                assert got, "the server closed the connection"
                left[number] -= got
                if not left[number]:
                    selector.unregister(clients[number])
                    if not fairness:
                        shares = [1 - rest / all_ for rest, all_ in zip(left, totals, strict=True)]
                        fairness = min(shares) / max(shares)
    return fairness


def drain_paced(
    clients: list[socket.socket], left: list[int], bytes_per_s: float, until: Callable[[], bool]
) -> None:
    """Read so much per second from each client, in ticks of 20 ms, until one has its bytes.

    Parameters
    ----------
    clients
        Connected; non-blocking afterwards.
    left
        Bytes that each is to receive; counted down in place.
    bytes_per_s
        Of each client; what does not come in its tick is not made up for.
    until
        Ends it sooner.
    """
    buffer = bytearray(int(bytes_per_s * _TICK_S))
    for client in clients:
        client.setblocking(False)
    next_s = time.perf_counter()
    while not until():
        for number, client in enumerate(clients):
            try:
                left[number] -= client.recv_into(buffer, min(len(buffer), left[number]))
            except BlockingIOError:
                continue
            if not left[number]:
                return
        next_s += _TICK_S
        time.sleep(max(0.0, next_s - time.perf_counter()))
