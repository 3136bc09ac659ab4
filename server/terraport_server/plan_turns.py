"""Whose landing is planned next: the client's that has used the least.

A plan costs as much as the landing is wide: from a tenth of a millisecond to several. Here every
client that wants one asks for a turn, and pays for it by the segments that were looked at. One plan
is made between two looks at the network. So who lands widely all the time waits behind everybody
who does not, and never holds them up for more than the one plan that is being made.

References
----------
P. Goyal, H. M. Vin, H. Cheng, "Start-time fair queueing", SIGCOMM 1996: an entry's *start* is the
client's *finish* of before, or where the queue is now if that is later; the earliest start goes
first. The cost may be unknown until it is paid.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Final

__all__ = ["PlanAccount", "PlanTurns"]

LEAST_COST: Final = 500
"""Of one plan, in segments looked at: message, supersede and system calls cost about as much."""


class PlanAccount:
    """What one client has used of the common time."""

    __slots__ = ("finish",)

    def __init__(self) -> None:
        self.finish = 0.0
        """Segments looked at, on the queue's scale."""


class PlanTurns:
    """Gives the clients of one event loop their turns to be planned for."""

    def __init__(self) -> None:
        self._waiting: list[
            tuple[float, float, int, asyncio.Future[None], PlanAccount, Callable[[], int]]
        ] = []
        self._number = 0
        """Of equal starts the one that has used less goes first, then the one that asked first."""
        self._now = 0.0
        """Start of the newest turn."""
        self._running = False

    def __len__(self) -> int:
        """Return how many clients wait."""
        return sum(not entry[3].done() for entry in self._waiting)

    async def take(self, account: PlanAccount, make: Callable[[], int]) -> None:
        """Call *make* when it is this client's turn.

        At most one at a time for each account. Cancelling it gives the place up.

        Parameters
        ----------
        account
            The client's.
        make
            Makes the plan without waiting; returns how many segments it looked at.

        Raises
        ------
        Exception
            Whatever *make* raises.
        """
        loop = asyncio.get_running_loop()
        start = max(self._now, account.finish)
        if not self._running:  # nobody waits: no need to go round the loop first
            self._running = True
            loop.call_soon(self._turn, loop)
            self._make(start, account, make)
            return
        done = loop.create_future()
        self._number += 1
        heappush(self._waiting, (start, account.finish, self._number, done, account, make))
        await done

    def _turn(self, loop: asyncio.AbstractEventLoop) -> None:
        while self._waiting:
            start, _, _, done, account, make = heappop(self._waiting)
            if done.done():
                continue
            try:
                self._make(start, account, make)
            except Exception as error:  # noqa: BLE001 - handed to who asked for the turn
                done.set_exception(error)
            else:
                done.set_result(None)
            loop.call_soon(self._turn, loop)
            return
        self._running = False

    def _make(self, start: float, account: PlanAccount, make: Callable[[], int]) -> None:
        self._now = start
        account.finish = start + LEAST_COST  # also where it raises
        account.finish += make()
