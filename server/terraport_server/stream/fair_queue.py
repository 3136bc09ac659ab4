"""A queue that takes its keys in turn, however much any of them has put in.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import deque
from heapq import heappop, heappush
from typing import Final, Generic, TypeVar

__all__ = ["EARNED", "FairQueue"]

T = TypeVar("T")

EARNED: Final = 4
"""Turns that a key has next which was away for as many rounds: a handshake, a hello and its
pieces."""

_LEAST_KEPT: Final = 1024
"""Keys that are away and whose last turn is remembered, at least; others only while it counts."""


class FairQueue(Generic[T]):
    """First in, first out for each key; one of each key at a time, in rounds.

    A key that was away for some rounds has as many turns next, `EARNED` at most; so who comes now
    and then does not wait for each of those who always have something. It is as long as what was
    put in; the caller bounds that.

    Start-time fair queueing (Goyal, Vin, Cheng 1996) where each turn costs one.

    Examples
    --------
    >>> queue = FairQueue[str]()
    >>> for key, item in (("a", "a1"), ("a", "a2"), ("a", "a3"), ("b", "b1")):
    ...     queue.add(key, item)
    >>> [queue.take() for _ in range(len(queue))]
    ['a1', 'b1', 'a2', 'a3']
    """

    def __init__(self) -> None:
        self._lines: dict[str, deque[T]] = {}
        self._order: list[tuple[int, int, str]] = []
        """Of each key that waits the round of its next turn; a heap."""
        self._rounds: dict[str, int] = {}
        """Of keys that had one lately the round of their next turn."""
        self._forget_at = _LEAST_KEPT
        self._now = 0
        """The newest round that has begun."""
        self._number = 0
        """Of equals the one that waits longest is first."""
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def add(self, key: str, item: T) -> None:
        """Put an item behind those of its key."""
        self._length += 1
        if key in self._lines:
            self._lines[key].append(item)
            return
        self._lines[key] = deque((item,))
        earliest = self._now - EARNED
        self._push(max(earliest, self._rounds.get(key, earliest)), key)

    def take(self) -> T:
        """Take the next item; raises IndexError where there is none."""
        if not self._order:
            raise IndexError("the queue is empty, expected an item")
        turn, _, key = heappop(self._order)
        self._now = max(self._now, turn)
        self._length -= 1
        line = self._lines[key]
        item = line.popleft()
        if line:
            self._push(turn + 1, key)
        else:
            del self._lines[key]
            self._remember(key, turn + 1)
        return item

    def _push(self, turn: int, key: str) -> None:
        self._number += 1
        heappush(self._order, (turn, self._number, key))

    def _remember(self, key: str, turn: int) -> None:
        self._rounds[key] = turn
        if len(self._rounds) > self._forget_at:
            earliest = self._now - EARNED
            self._rounds = {other: at for other, at in self._rounds.items() if at > earliest}
            self._forget_at = max(_LEAST_KEPT, 2 * len(self._rounds))
