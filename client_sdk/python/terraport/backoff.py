"""Reconnect delays, message rate, and error texts for servers that cannot be reached.

After a lost connection 0.5 s, then twice as long each time up to 30 s, each wait multiplied by a
random number in [0.5, 1], so that the clients of a restarted server do not all come back in the
same moment.

PURE: no I/O, no clock; time and chance are arguments.
"""

from __future__ import annotations

import errno
import re
import ssl
from collections.abc import Callable, Iterator
from typing import Final

from terraport_wire import CloseCode

__all__ = ["FIRST_WAIT_S", "LONGEST_WAIT_S", "Pacer", "is_temporary", "wait_s", "why_unreached"]

FIRST_WAIT_S: Final = 0.5
LONGEST_WAIT_S: Final = 30.0

_WINDOW_S: Final = 10.0
"""The protocol averages the message rate over 10 s."""
_MARGIN: Final = 0.8
"""Part of the allowance that is used: clocks and batching differ between the two sides."""

_ERRNO = re.compile(r"\[Errno (\d+)\]")

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


class Pacer:
    """Token bucket that stays within `per_s` messages per second over 10 s.

    Examples
    --------
    >>> pacer = Pacer(1.0, now_s=0.0)
    >>> [pacer.take(0.0) for _ in range(9)]
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.25]
    """

    __slots__ = ("_at_s", "_capacity", "_per_s", "_tokens")

    def __init__(self, per_s: float, *, now_s: float) -> None:
        self._per_s = per_s * _MARGIN
        self._capacity = max(1.0, self._per_s * _WINDOW_S)
        self._tokens = self._capacity
        self._at_s = now_s

    def take(self, now_s: float) -> float:
        """Book one message; return the seconds to wait before sending it, 0.0 for none."""
        passed_s = max(0.0, now_s - self._at_s)
        self._tokens = min(self._capacity, self._tokens + passed_s * self._per_s)
        self._at_s = max(self._at_s, now_s)
        self._tokens -= 1.0
        return max(0.0, -self._tokens / self._per_s)


def why_unreached(error: BaseException) -> str:
    """Say why a connection did not come about, and what may be wrong.

    Parameters
    ----------
    error : BaseException
        Of asyncio, ssl, websockets or httpx; those that it came of are looked at, too.

    Examples
    --------
    >>> why_unreached(ConnectionRefusedError(errno.ECONNREFUSED, "Connect call failed"))
    'nothing listens there; is the service running, and is this its port?'
    """
    for cause in _causes(error):
        if isinstance(cause, ssl.SSLCertVerificationError):
            return str(cause)
        if isinstance(cause, ssl.SSLError) and "WRONG_VERSION_NUMBER" in str(cause):
            return "what listens there speaks no TLS; expected http:// for it"
        # Of socket, which this module does not import.
        if type(cause).__name__ == "gaierror":
            return "no machine has that name"
        if isinstance(cause, TimeoutError):
            return "no answer in time"
        # Several addresses of one name, each refused, come as one error without a number.
        refused = {str(errno.ECONNREFUSED)}
        if isinstance(cause, OSError) and set(_ERRNO.findall(str(cause))) == refused:
            return "nothing listens there; is the service running, and is this its port?"
    return str(error) or type(error).__name__


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Walk from an error to what it came of; no chain of ours is long."""
    current: BaseException | None = error
    while current is not None:
        yield current
        current = current.__cause__ or current.__context__
