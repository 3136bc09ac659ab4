"""Attacks on groups, with a token: seats that are taken and left behind, and storms in a group.

As in :mod:`attacks.load`, each runs from one address until it is told to stop.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
import struct
import time
from collections.abc import Callable
from typing import Final

from attacks.plans import BURST, WISHES_PER_S
from attacks.strangers import Attack, Going
from parts.drain_client import DrainClient

from terraport_wire import Arrived, Gather, Join, Joined, Message

__all__ = ["SEAT_ATTACKS"]

CYCLES_PER_S: Final = 64.0

MEMBERS: Final = 24
"""Of one group: ten addresses leave room for somebody else among `max_sessions`."""


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


def gather_storms(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Have as large a group as one address may, and land it as often as one client may say so."""

    def says(turn: int, is_guide: bool) -> list[Message]:
        gather = Gather(request=turn, position=(500.0, 0.0, 500.0), radius_m=100.0)
        return [gather] if is_guide else []

    return _storm(port, scene, token, going, address, says)


def arrival_storms(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Have as large a group, land it once, and say as often as may be that one has not arrived."""

    def says(turn: int, is_guide: bool) -> list[Message]:
        if is_guide and not turn:
            return [Gather(request=turn, position=(500.0, 0.0, 500.0), radius_m=100.0)]
        return [Arrived(gathering=1, state="degraded")]

    return _storm(port, scene, token, going, address, says)


def join_storms(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Have as large a group, in which all leave and join as often as they may."""

    def says(turn: int, is_guide: bool) -> list[Message]:
        if is_guide:
            return []
        return [Join(request=turn, group=f"storm-{address}", role="member", name="\U0001f98a" * 64)]

    return _storm(port, scene, token, going, address, says)


def _storm(
    port: int,
    scene: str,
    token: str,
    going: Going,
    address: str,
    says: Callable[[int, bool], list[Message]],
) -> int:
    """Have a group of one address, each of whom says something again and again."""
    clients: list[DrainClient] = []
    done, began_s = 0, time.monotonic()
    try:
        for number in range(MEMBERS):
            with contextlib.suppress(OSError, AssertionError):
                client = DrainClient("127.0.0.1", port, scene, address=address)
                clients.append(client)
                client.hello(credit_bytes=0, token=token)
                role = "guide" if not number else "member"
                client.send(Join(request=0, group=f"storm-{address}", role=role))
                client.socket.setblocking(False)
        turns = 0
        began_s = time.monotonic()
        while going():
            time.sleep(0.002)
            may = turns < BURST + WISHES_PER_S * (time.monotonic() - began_s)
            for number, client in enumerate(clients):
                said = says(turns, not number) if may else []
                done += len(said)
                with contextlib.suppress(OSError, AssertionError):
                    if said:
                        client.send(*said)
                with contextlib.suppress(OSError):
                    while client.socket.recv(1 << 16):
                        pass
            turns += may
    finally:
        for client in clients:
            client.close()
    return done


SEAT_ATTACKS: Final[dict[str, Attack]] = {
    "left seats": left_seats,
    "gather storms": gather_storms,
    "arrival storms": arrival_storms,
    "join storms": join_storms,
}
