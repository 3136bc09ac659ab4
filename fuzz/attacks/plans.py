"""Attacks on the time in which landings are planned: as wide and as many as one client may ask for.

As those of :mod:`attacks.load`: bounded, from an address of their own, until told to stop.
"""

from __future__ import annotations

import contextlib
import time
from typing import Final

import numpy as np
from attacks.strangers import Attack, Going
from parts.drain_client import DrainClient

from terraport_wire import KEY_DTYPE, MAX_HAVE, Land, Message, Pick, Picked, Plan, Prefetch

__all__ = ["PLAN_ATTACKS", "StalledClient"]

BURST: Final = 580
"""Messages that the service takes at once by default, less a few."""

WISHES_PER_S: Final = 58.0

RADIUS_M: Final = 500.0

STALLED: Final = 8

_KEYS: Final = np.random.default_rng(20).integers(0, 1 << 63, MAX_HAVE).astype(KEY_DTYPE)
"""Keys of no segment."""


def wide_landings(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Land with the largest radius and the longest list of keys, as often as one client may."""
    return _wish(port, scene, token, going, address, Land)


def wide_prefetches(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Prefetch as widely and as often."""
    return _wish(port, scene, token, going, address, Prefetch)


def stalled_landings(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Land as widely and as often, with several connections that never read."""
    clients: list[StalledClient] = []
    done = 0
    with contextlib.suppress(OSError, AssertionError):
        clients += [StalledClient(port, scene, token, address) for _ in range(STALLED)]
    while going() and clients:
        done += sum(client.land() for client in clients)
        time.sleep(1 / WISHES_PER_S)
    for client in clients:
        client.close()
    return done


def stalled_beside_wide(port: int, scene: str, token: str, going: Going, address: str) -> int:
    """Have those that never read, and one that reads and lands on."""
    clients = [StalledClient(port, scene, token, address) for _ in range(STALLED)]
    try:

        def both() -> bool:
            for client in clients:
                client.land()
            return going()

        return _wish(port, scene, token, both, address, Land)
    finally:
        for client in clients:
            client.close()


PLAN_ATTACKS: Final[dict[str, Attack]] = {
    "wide landings": wide_landings,
    "wide prefetches": wide_prefetches,
    "landings never read": stalled_landings,
    "landings, and never read": stalled_beside_wide,
}


class StalledClient:
    """Says hello, lands on, and reads nothing more.

    Parameters
    ----------
    port, scene, token
        Of the service.
    address
        To come from.
    """

    def __init__(self, port: int, scene: str, token: str, address: str) -> None:
        self._client = DrainClient("127.0.0.1", port, scene, receive_buffer=4096, address=address)
        self._client.hello(credit_bytes=0, token=token)
        self._client.socket.setblocking(False)
        self._generation = 0
        self._began_s = time.monotonic()

    def land(self) -> int:
        """Send what the rate allows and the socket takes; return how many landings that was."""
        due = BURST + int(WISHES_PER_S * (time.monotonic() - self._began_s))
        done = 0
        # A frame that the socket takes in part would end the session: then it says nothing more.
        with contextlib.suppress(OSError, AssertionError):
            while self._generation < due:
                self._client.send(_wanted(Land, self._generation + 1))
                self._generation += 1
                done += 1
        return done

    def close(self) -> None:
        """Drop the connection."""
        self._client.close()


def _wish(
    port: int, scene: str, token: str, going: Going, address: str, kind: type[Land | Prefetch]
) -> int:
    """Ask for as many as one client may, and read what is answered."""
    done = 0
    while going():
        with contextlib.suppress(OSError, AssertionError):
            client = DrainClient("127.0.0.1", port, scene, address=address)
            try:
                client.hello(credit_bytes=0, token=token)
                left, began_s = BURST, time.monotonic()
                while going():
                    count = min(16, left + int(WISHES_PER_S * (time.monotonic() - began_s)))
                    if count > 0:
                        _ask(client, kind, count)
                        left -= count
                        done += count
                    else:
                        time.sleep(1 / WISHES_PER_S)
            finally:
                client.close()
    return done


def _ask(client: DrainClient, kind: type[Land | Prefetch], count: int) -> None:
    """Ask so many times in one write, and read until the newest is answered."""
    first = client.generation + 1
    client.generation += count
    wishes = [_wanted(kind, first + at) for at in range(count)]
    client.send(*wishes, Pick(request=client.generation, origin=(-9e6, 0.0, 0.0)))
    while True:
        answer = client.message()
        if isinstance(answer, Picked) and answer.request == client.generation:
            return
        assert isinstance(answer, Plan | Picked), answer


def _wanted(kind: type[Land | Prefetch], generation: int) -> Message:
    return kind(
        generation=generation,
        position=(500.0 + 10 * (generation % 16), 0.0, 500.0),
        radius_m=RADIUS_M,
        have=_KEYS,
        taken_bytes=0,
    )
