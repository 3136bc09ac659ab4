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


def drain_all(clients: list[socket.socket], left: list[int]) -> float:
    """Read until every client has its bytes.

    Parameters
    ----------
    clients
        Connected.
    left
        Bytes that each is to receive.

    Returns
    -------
    float
        Fairness: bytes of the slowest client over bytes of the fastest when the fastest was done.
    """
    buffer = bytearray(_PIECE)
    wanted, left = list(left), list(left)
    fairness = 0.0
    with selectors.DefaultSelector() as selector:
        for number, client in enumerate(clients):
            selector.register(client, selectors.EVENT_READ, number)
        while selector.get_map():
            for key, _ in selector.select(60):
                number = key.data
                got = clients[number].recv_into(buffer, min(_PIECE, left[number]))
                assert got, "the server closed the connection"
                left[number] -= got
                if not left[number]:
                    selector.unregister(clients[number])
                    if not fairness:
                        shares = [1 - rest / all_ for rest, all_ in zip(left, wanted, strict=True)]
                        fairness = min(shares) / max(shares)
    return fairness


def drain_paced(
    clients: list[socket.socket], bytes_per_s: float, until: Callable[[], bool]
) -> list[int]:
    """Read so much per second from each client; return what each received.

    A tick is 20 ms; what does not come in one is not made up for.
    """
    tick_s = 0.02
    buffer = bytearray(max(1, int(bytes_per_s * tick_s)))
    received = [0] * len(clients)
    for client in clients:
        client.setblocking(False)
    next_s = time.perf_counter()
    while not until():
        for number, client in enumerate(clients):
            try:
                received[number] += client.recv_into(buffer)
            except BlockingIOError:
                continue
        next_s += tick_s
        time.sleep(max(0.0, next_s - time.perf_counter()))
    return received
