"""Whose payload goes next: one burst at a time, new landings first.

Sockets take payload faster than clients ask for it, so without an order the first client to be
served would be served whole, and a landing that came a moment later would wait behind it. Here
every client that has something to send asks for a turn. One turn is one burst of bounded size;
between two of them the event loop looks at the network once, so that a new landing is seen within
one burst of whatever is under way.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Final, NamedTuple

__all__ = ["Pause", "Rank", "Turns", "rank_of"]

_FIRST_IN_A_ROW: Final = 8
"""Turns of new landings before another landing gets one: landing anew all the time starves nobody.
"""

_NEW_LANDING_BYTES: Final = 1 << 20
"""So much of a landing goes before what is left of others'."""

_LEAST_FIRST_BYTES: Final = 16 << 10
"""Of what goes first: a turn costs nearly the same whatever it carries, and whoever grants credit
by the byte would otherwise take one ahead of everybody for each of them."""


class Rank(IntEnum):
    """What a turn is asked for."""

    NEW_LANDING = 0
    """The first bytes of a landing, which somebody waits for in the dark."""
    LANDING = 1
    AIM = 2
    """May come to nothing: goes when no landing could use the turn."""


def rank_of(*, landing: bool, sent_bytes: int, next_bytes: int, rest_bytes: int) -> Rank:
    """Tell what a turn for payload is worth.

    Parameters
    ----------
    landing : bool
        Whether it is a landing's; an aim's otherwise.
    sent_bytes : int
        Payload of the landing that was sent already.
    next_bytes : int
        What the client's credit lets go of the segment now, at most a chunk.
    rest_bytes : int
        What is left of the segment.

    Examples
    --------
    >>> rank_of(landing=True, sent_bytes=0, next_bytes=131072, rest_bytes=200000).name
    'NEW_LANDING'
    >>> rank_of(landing=True, sent_bytes=0, next_bytes=1, rest_bytes=200000).name
    'LANDING'
    """
    if not landing:
        return Rank.AIM
    is_worth_it = next_bytes >= min(_LEAST_FIRST_BYTES, rest_bytes)
    if sent_bytes < _NEW_LANDING_BYTES and is_worth_it:
        return Rank.NEW_LANDING
    return Rank.LANDING


class Pause(NamedTuple):
    """Why a turn ends before its end: the socket is full."""

    rank: Rank
    """Of what is left."""
    until: Callable[[Callable[[], None]], None]
    """Calls back, once, when there is room or the connection is over."""


Burst = Callable[[], Rank | Pause | None]
"""Sends a bounded amount without waiting; returns the rank of what is left, ``None`` where there is
nothing to send."""


_Entry = tuple[asyncio.Future[None], Burst]


class Turns:
    """Gives the senders of one event loop their turns."""

    def __init__(self) -> None:
        self._waiting: tuple[deque[_Entry], ...] = tuple(deque() for _ in Rank)
        self._running = False
        self._new_in_a_row = 0

    def __len__(self) -> int:
        """Return how many senders wait."""
        return sum(len(queue) for queue in self._waiting)

    @property
    def is_busy(self) -> bool:
        """Whether :meth:`take` waits before it sends."""
        return self._running

    async def take(self, rank: Rank, burst: Burst) -> None:
        """Send by *burst*, turn by turn, until it returns ``None``.

        A burst that pauses goes on when it is called back: in that very step where nobody has a
        turn, so that a socket that fills a dozen times in a landing costs no steps of the event
        loop beside those in which it is empty.

        Cancelling it gives the place up.

        Raises
        ------
        Exception
            Whatever *burst* raises.
        """
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._ask(rank, (done, burst))
        if done.done():  # without a step of the loop
            done.result()
        else:
            await done

    def _ask(self, rank: Rank, entry: _Entry) -> None:
        if self._running:
            self._waiting[rank].append(entry)
        elif not entry[0].done():
            # Nobody waits: no need to go round the loop first.
            self._running = True
            asyncio.get_running_loop().call_soon(self._turn)
            self._send(entry)

    def _turn(self) -> None:
        entry = self._next()
        if entry is None:
            self._running = False
            return
        self._send(entry)
        asyncio.get_running_loop().call_soon(self._turn)

    def _send(self, entry: _Entry) -> None:
        done, burst = entry
        try:
            left = burst()
        except Exception as error:  # noqa: BLE001 - handed to who asked for the turn
            done.set_exception(error)
            return
        if left is None:
            done.set_result(None)
        elif isinstance(left, Pause):
            left.until(partial(self._ask, left.rank, entry))
        else:
            self._waiting[left].append(entry)

    def _next(self) -> _Entry | None:
        """Take the next entry whose sender still waits."""
        new, old, aims = self._waiting
        while new or old or aims:
            if new and (self._new_in_a_row < _FIRST_IN_A_ROW or not old):
                self._new_in_a_row += 1
                entry = new.popleft()
            else:
                self._new_in_a_row = 0
                entry = (old or aims).popleft()
            if not entry[0].done():
                return entry
        return None
