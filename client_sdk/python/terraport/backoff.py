"""How long to wait before connecting again, and after which failures at all.

Wire protocol, sections 10.1 and 11: 0.5 s, then twice as long each time up to 30 s, each wait
multiplied by a random number in [0.5, 1], so that the clients of a restarted server do not all
come back in the same moment.

PURE: no I/O, no clock; chance is an argument.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from terraport_wire import CloseCode

__all__ = ["FIRST_WAIT_S", "LONGEST_WAIT_S", "is_temporary", "wait_s"]

FIRST_WAIT_S: Final = 0.5
LONGEST_WAIT_S: Final = 30.0

_FINAL: Final = frozenset(
    {
        CloseCode.NORMAL,
        CloseCode.MALFORMED,
        CloseCode.UNAUTHORISED,
        CloseCode.FORBIDDEN,
        CloseCode.UNKNOWN_SCENE,
        CloseCode.VERSION,
        CloseCode.TOO_LARGE,
    }
)


def wait_s(attempt: int, chance: Callable[[], float]) -> float:
    """Return the seconds to wait before an attempt.

    Parameters
    ----------
    attempt : int
        0 for the first one after the loss.
    chance : callable
        Gives numbers in [0, 1), like ``random.random``.

    Examples
    --------
    >>> [wait_s(attempt, lambda: 1.0) for attempt in (0, 1, 2, 6, 1000)]
    [0.5, 1.0, 2.0, 30.0, 30.0]
    >>> wait_s(0, lambda: 0.0)
    0.25
    """
    doubled = FIRST_WAIT_S * 2.0 ** min(attempt, 16)
    return min(LONGEST_WAIT_S, doubled) * (0.5 + 0.5 * chance())


def is_temporary(close_code: int) -> bool:
    """Whether a connection closed with this code is worth another attempt.

    Everything is, but for what the server will refuse again.
    """
    return close_code not in _FINAL
