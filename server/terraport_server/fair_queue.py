"""A queue that takes its keys in turn, however much any of them has put in.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

__all__ = ["FairQueue"]

T = TypeVar("T")


class FairQueue(Generic[T]):
    """First in, first out for each key; one of each key at a time, in the order of their coming.

    Whoever comes waits for one of each other key at most. It is as long as what was put in; the
    caller bounds that.

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
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def add(self, key: str, item: T) -> None:
        """Put an item behind those of its key."""
        self._lines.setdefault(key, deque()).append(item)
        self._length += 1

    def take(self) -> T:
        """Take the next item; raises IndexError where there is none."""
        if not self._lines:
            raise IndexError("the queue is empty, expected an item")
        key = next(iter(self._lines))
        line = self._lines.pop(key)
        item = line.popleft()
        if line:
            self._lines[key] = line  # behind all others
        self._length -= 1
        return item
