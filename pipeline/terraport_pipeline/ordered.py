"""Work in threads, results in order, a few items at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, TypeVar

__all__ = ["in_order"]

_QUEUE_PER_THREAD: Final = 4
"""Items in work per thread: enough to keep all busy, few enough to bound the memory."""

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def in_order(
    work: Callable[[_Item], _Result], items: Iterable[_Item], threads: int
) -> Iterator[_Result]:
    """Do some work on every item, in threads, and yield the results in the order of the items.

    Parameters
    ----------
    work : callable
        Worth a thread where it releases the interpreter's lock.
    items : iterable
        Taken one by one as places get free, in the caller's thread.
    threads : int
        At least 1.

    Yields
    ------
    Results. An error of the work is raised in its place; what has not begun by then is not done.
    """
    waiting: deque[Future[_Result]] = deque()
    with ThreadPoolExecutor(max_workers=threads) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(work, item))
                if len(waiting) >= _QUEUE_PER_THREAD * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
