"""Long loops in pieces, for several threads, with results that do not depend on their number.

A compiled kernel that works on items ``begin..end`` and releases the interpreter's lock
(``nogil=True``) is called once per piece. Pieces are cut at fixed places whatever the number of
threads, so sums over pieces are added in one order and come out equal to the last bit. (numba's own
``prange`` would do the loops too; its kernels take four times as long to compile, and two of them
at once abort the process with the threading layer that is always there.)

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, TypeVar

__all__ = ["CHUNK", "in_chunks", "side_by_side"]

CHUNK: Final = 2**18
"""Items in a piece: a few milliseconds of work, so that two threads end together, and few enough
pieces that starting them costs nothing."""

_Result = TypeVar("_Result")


def in_chunks(
    work: Callable[[int, int], _Result], n_items: int, *, threads: int = 1, chunk: int = CHUNK
) -> list[_Result]:
    """Call ``work(begin, end)`` for every piece of 0..n_items.

    Parameters
    ----------
    work : callable
        Gets the piece's first item and the one behind its last. Pieces must not depend on each
        other.
    n_items : int
        Number of items; 0 calls nothing.
    threads : int
        Threads at most, >= 1.
    chunk : int
        Items in a piece.

    Returns
    -------
    list
        The pieces' results in order.

    Examples
    --------
    >>> in_chunks(lambda begin, end: end - begin, 10, threads=2, chunk=4)
    [4, 4, 2]
    """
    pieces = [(begin, min(begin + chunk, n_items)) for begin in range(0, n_items, chunk)]
    if threads == 1 or len(pieces) < 2:
        return [work(begin, end) for begin, end in pieces]
    with ThreadPoolExecutor(max_workers=min(threads, len(pieces))) as pool:
        return list(pool.map(lambda piece: work(*piece), pieces))


def side_by_side(tasks: Sequence[Callable[[], Any]], *, threads: int = 1) -> list[Any]:
    """Results of independent tasks in order, each in a thread of its own where that is allowed.

    Parameters
    ----------
    tasks : sequence of callable
        Without arguments, independent of each other.
    threads : int
        1 does one after the other.

    Returns
    -------
    list

    Examples
    --------
    >>> side_by_side([lambda: "a", lambda: "b"], threads=2)
    ['a', 'b']
    """
    if threads == 1 or len(tasks) < 2:
        return [task() for task in tasks]
    with ThreadPoolExecutor(max_workers=min(threads, len(tasks))) as pool:
        return [future.result() for future in [pool.submit(task) for task in tasks]]
