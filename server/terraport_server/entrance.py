"""The way in of one process: who is not let in takes its steps on the event loop one at a time.

A flood of handshakes or requests is not refused for being many: it waits, its addresses in turn,
and between two steps it is the turn of everything else. What a step of the loop spends on all
strangers together is therefore one read, one handshake, or the beginning of one request, however
many they are. An address that was away has its first steps next: a client that comes waits for the
step that is being done, and not for one of each address that always has another.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final, Protocol

from terraport_server.client_addresses import ARRIVALS_S, ClientAddresses, too_many_of_address
from terraport_server.small_reads import READ_BYTES
from terraport_server.strangers import Strangers
from terraport_server.stream.fair_queue import FairQueue

__all__ = ["ADDRESS_SHARE", "PROXIES", "Entrance", "Stranger"]

PROXIES: Final = "proxies"
"""Whose turn it is where a proxy does not say for whom it asks."""

ADDRESS_SHARE: Final = 8
"""One address may have a so-manieth part of what all strangers may have sent: ten clients that
offer as much as they may, two hundred that offer what is usual."""

_FLOOD: Final = 2
"""Connections one too many are answered as long as there are fewer than so many times the bound;
more are turned away unheard."""

_ARRIVALS: Final = 10
"""An address may connect anew so many times the bound in `ARRIVALS_S`: each second all of them."""

_IN_VAIN: Final = 2
"""And so many times the bound without being let in or getting a good answer: a handshake that leads
nowhere costs 0.6 ms, a connection turned away unheard 0.02."""

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
    max_bytes
        What all strangers together may have sent.
    max_of_address
        Connections of one address.
    """

    def __init__(self, trusted: str, max_bytes: int, max_of_address: int = 64) -> None:
        self._max_bytes = max_bytes
        self._max_of_address = max_of_address
        self._coming: Counter[str] = Counter()
        self.room = memoryview(bytearray(READ_BYTES))
        """What is read of strangers goes through it, a piece at a time."""
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

    def ask(self, key: str, step: Step) -> None:
        """Do a step: now where none was done in this step of the event loop, or as :meth:`wait`."""
        if self._goes_on:
            self.wait(key, step)
            return
        self._goes_on = True
        asyncio.get_running_loop().call_soon(self._next)
        step()

    async def turn(self, key: str) -> None:
        """Return when it is its turn, as :meth:`ask`."""
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def step() -> None:
            if not done.done():  # given up
                done.set_result(None)

        self.ask(key, step)
        await done

    def turns_away(self, key: str, now_s: float) -> str | None:
        """Count who arrives; return why it is not even heard, or None.

        Whoever is in the middle of a TLS handshake has no connection yet, and counts all the same.
        """
        addresses, most = self.addresses, self._max_of_address
        of_address = addresses.open_of(key) + self._coming[key]
        arrived = addresses.arrive(key, now_s)
        if of_address >= _FLOOD * most:
            return too_many_of_address(of_address + 1, most)
        if arrived > _ARRIVALS * most:
            text = f"got connection {arrived} of one address in {ARRIVALS_S:g} s"
            return f"{text}, expected at most {_ARRIVALS * most}"
        return self.is_in_vain(key, now_s)

    def turned_away_until(self, key: str, now_s: float) -> float | None:
        """Return until when an address is turned away whatever it does, or None."""
        most = self._max_of_address
        arrived, ends_s = self.addresses.arrived(key, now_s)
        is_often = arrived > _ARRIVALS * most or self.is_in_vain(key, now_s) is not None
        return ends_s if is_often else None

    def is_in_vain(self, key: str, now_s: float) -> str | None:
        """Return why an address is not heard that came again and again for nothing, or None."""
        in_vain, most = self.addresses.in_vain(key, now_s), _IN_VAIN * self._max_of_address
        if in_vain <= most:
            return None
        text = f"got {in_vain} connections of one address in {ARRIVALS_S:g} s for nothing"
        return f"{text}, expected at most {most}"

    @contextlib.contextmanager
    def coming(self, key: str | None) -> Iterator[None]:
        """Count a connection that is not made yet."""
        if key is None:
            yield
            return
        self._coming[key] += 1
        try:
            yield
        finally:
            self._coming[key] -= 1
            if not self._coming[key]:
                del self._coming[key]

    def heaviest_coming(self) -> str | None:
        """Return the address with most connections that are not made yet, or None."""
        return max(self._coming, key=self._coming.__getitem__, default=None)

    def make_room(self) -> bool:
        """Let the stranger leave that stands most in the way; False where there is none."""
        peer = self.strangers.in_the_way()
        if peer is None:
            return False
        self.strangers.leave(peer)
        peer.give_way("got more connections than there is room for, most of them of this address")
        return True

    def weigh(self, peer: Stranger, count: int) -> None:
        """Note that a stranger sent so many bytes, or fewer count; who has too many leaves.

        Of its own address the heaviest, of all the heaviest of the heaviest address.
        """
        of_address = self.strangers.weigh(peer, count)
        if count > 0 and of_address > self._max_bytes // ADDRESS_SHARE:
            # One is enough: whoever has most has no less than what came now.
            self._show_out(self.strangers.heaviest_beside(peer), ADDRESS_SHARE)
        while self.strangers.total_bytes > self._max_bytes:
            self._show_out(self.strangers.heaviest(), 1)

    def _show_out(self, peer: Stranger | None, share: int) -> None:
        """Let a stranger leave that has too many bytes."""
        assert peer is not None  # whose bytes are they?
        self.strangers.leave(peer)
        whose = "clients that are not let in" if share == 1 else "such clients of one address"
        peer.give_way(f"got more than {self._max_bytes // share} bytes from {whose}")

    def _go_on(self) -> None:
        if not self._goes_on and self._waiting:
            self._goes_on = True
            asyncio.get_running_loop().call_soon(self._next)

    def _next(self) -> None:
        self._goes_on = False
        if not self._waiting:
            return
        step = self._waiting.take()
        self._go_on()  # first: a step that fails must not stop the others
        step()
