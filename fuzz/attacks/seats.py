"""Attacks on groups, with a token: seats that are taken and left behind.

As in :mod:`attacks.load`, each runs from one address until it is told to stop.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
import struct
import time
from typing import Final

from attacks.strangers import Attack, Going
from parts.drain_client import DrainClient

from terraport_wire import Join, Joined

__all__ = ["SEAT_ATTACKS"]

CYCLES_PER_S: Final = 64.0


def left_seats(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Found a group, and drop the connection: its seat is kept for a while."""
    done, began_s = 0, time.monotonic()
    while going():
        if done > CYCLES_PER_S * (time.monotonic() - began_s):
            time.sleep(0.001)
            continue
        with contextlib.suppress(OSError, AssertionError):
            client = DrainClient("127.0.0.1", port, scene, address=address)
            try:
                client.hello(credit_bytes=0, token=token)
                client.send(Join(request=1, group=secrets.token_hex(8), role="guide"))
                done += isinstance(client.message(), Joined)
            finally:
                # Gone without a close, as if the link had been cut.
                client.socket.setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
                )
                client.close()
    return done


SEAT_ATTACKS: Final[dict[str, Attack]] = {"left seats": left_seats}
