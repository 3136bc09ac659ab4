"""The way in of one process: who is not let in takes its steps on the event loop one at a time.

A flood of handshakes or requests is not refused for being many: it waits, its addresses in turn,
and between two steps it is the turn of everything else. What a step of the loop spends on all
strangers together is therefore one read, one handshake, or the beginning of one request, however
many they are; and a client that comes waits for one step of each other address.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from terraport_server.client_addresses import ClientAddresses
from terraport_server.fair_queue import FairQueue
from terraport_server.strangers import MAX_STRANGER_BYTES, Strangers

__all__ = ["Entrance", "Stranger"]

Step = Callable[[], None]


class Stranger(Protocol):
    """A connection that can be made to leave."""

    def give_way(self, text: str) -> None:
        """Drop the connection; the text says why, for metric and log."""


class Entrance:
    """Counts, turns and bounds of those who are not let in. Lives on one event loop.

    Parameters
    ----------
    trusted
        Proxies, as of :class:`ClientAddresses`.
    """

    def __init__(self, trusted: str) -> None:
        self.addresses = ClientAddresses(trusted)
        self.strangers = Strangers[Stranger]()
        self._waiting = FairQueue[Step]()
        self._goes_on = False

    def wait(self, key: str, step: Step) -> None:
        """Do a step when it is its turn, in a later step of the event loop.

        Its caller waits for it before it asks for another, so that no more wait than there are
        connections.
        """
        self._waiting.add(key, step)
        self._go_on()

    def make_room(self) -> bool:
        """Let the stranger leave that stands most in the way; False where there is none."""
        peer = self.strangers.in_the_way()
        if peer is None:
            return False
        self.strangers.leave(peer)
        peer.give_way("got more connections than there is room for, most of them of this address")
        return True

    def weigh(self, peer: Stranger, count: int) -> None:
        """Note that a stranger sent so many bytes; the heaviest leaves where all are too many."""
        self.strangers.weigh(peer, count)
        while self.strangers.total_bytes > MAX_STRANGER_BYTES:
            heaviest = self.strangers.heaviest()
            assert heaviest is not None  # whose bytes are they?
            self.strangers.leave(heaviest)
            most = MAX_STRANGER_BYTES
            heaviest.give_way(f"got more than {most} bytes from clients that are not let in")

    def _go_on(self) -> None:
        if not self._goes_on and self._waiting:
            self._goes_on = True
            asyncio.get_running_loop().call_soon(self._next)

    def _next(self) -> None:
        self._goes_on = False
        step = self._waiting.take()
        self._go_on()  # first: a step that fails must not stop the others
        step()
