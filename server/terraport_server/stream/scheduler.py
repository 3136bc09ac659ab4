"""Order in which clients send payload: new landings first, then landings, then prefetches.

Sockets take payload faster than clients ask for it. Every client that has something to send asks
for a turn of bounded size; turns of at most `STEP_BYTES` run in one iteration of the event loop, so
a new landing is seen after at most that much payload of others.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from enum import IntEnum
from typing import Final

__all__ = ["STEP_BYTES", "TURN_BYTES", "Burst", "Rank", "SendScheduler", "rank_of"]

STEP_BYTES: Final = 2 << 20
"""Payload of all clients in one iteration of the event loop."""

TURN_BYTES: Final = 512 << 10
"""Payload of one client before others have their turn."""

_LEAST_TURN_BYTES: Final = 16 << 10
"""Bytes that any turn counts as: its cost hardly depends on what it carries."""

_NEW_LANDINGS_IN_A_ROW: Final = 8
"""Maximum consecutive turns of new landings, so that repeated landing starves no other client."""

_NEW_LANDING_BYTES: Final = 1 << 20
"""Bytes of a landing that go before the rest of other landings."""


class Rank(IntEnum):
    """Priority of a turn; lower goes first."""

    NEW_LANDING = 0
    """First bytes of a landing, while the client's view is dark."""
    LANDING = 1
    PREFETCH = 2
    """May turn out useless: sent when no landing could use the turn."""


def rank_of(*, landing: bool, sent_bytes: int, next_bytes: int, rest_bytes: int) -> Rank:
    """Return the priority of payload.

    Parameters
    ----------
    landing : bool
        Whether it belongs to a landing, not to a prefetch.
    sent_bytes : int
        Payload of the landing that was sent already.
    next_bytes : int
        Bytes of the segment that the client's credit allows now, at most a chunk.
    rest_bytes : int
        Unsent bytes of the segment.

    Examples
    --------
    >>> rank_of(landing=True, sent_bytes=0, next_bytes=131072, rest_bytes=200000).name
    'NEW_LANDING'
    >>> rank_of(landing=True, sent_bytes=0, next_bytes=1, rest_bytes=200000).name
    'LANDING'
    """
    if not landing:
        return Rank.PREFETCH
    # Credit granted byte by byte would otherwise take a turn before everybody else for each byte.
    is_large = next_bytes >= min(_LEAST_TURN_BYTES, rest_bytes)
    return Rank.NEW_LANDING if sent_bytes < _NEW_LANDING_BYTES and is_large else Rank.LANDING


Burst = Callable[[], tuple[int, Rank | None]]
"""Sends up to `TURN_BYTES` without waiting; returns the bytes sent and the rank of what could be
sent at once, None where that is nothing. It handles its own exceptions."""


class SendScheduler:
    """Runs the bursts of all clients of one event loop."""

    def __init__(self) -> None:
        self._waiting: tuple[deque[Burst], ...] = tuple(deque() for _ in Rank)
        self._is_scheduled = False
        self._left_bytes = STEP_BYTES
        """Payload that may be sent before the event loop looks at the network again."""
        self._new_in_a_row = 0

    def ask(self, rank: Rank, burst: Burst) -> None:
        """Run a burst, at once if no other waits, and again while payload is left."""
        if self._is_scheduled or self._left_bytes <= 0:
            self._waiting[rank].append(burst)
        else:
            self._send(burst)
        self._schedule()

    def _schedule(self) -> None:
        if not self._is_scheduled and any(self._waiting):
            self._is_scheduled = True
            asyncio.get_running_loop().call_soon(self._step)

    def _step(self) -> None:
        self._left_bytes = STEP_BYTES
        while self._left_bytes > 0 and (burst := self._next()) is not None:
            self._send(burst)
        self._is_scheduled = False
        self._schedule()

    def _send(self, burst: Burst) -> None:
        sent_bytes, rest = burst()
        self._left_bytes -= max(sent_bytes, _LEAST_TURN_BYTES)
        if rest is not None:
            self._waiting[rest].append(burst)

    def _next(self) -> Burst | None:
        new, old, prefetches = self._waiting
        if new and (self._new_in_a_row < _NEW_LANDINGS_IN_A_ROW or not old):
            self._new_in_a_row += 1
            return new.popleft()
        self._new_in_a_row = 0
        queue = old or prefetches
        return queue.popleft() if queue else None
