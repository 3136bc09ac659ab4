"""How fast the client may speak: the server's message rate, kept from this side.

PURE: no I/O; time is an argument.
"""

from __future__ import annotations

from typing import Final

__all__ = ["Pacer"]

_WINDOW_S: Final = 10.0
"""The wire protocol averages the rate over 10 s (section 12)."""
_MARGIN: Final = 0.8
"""Part of the allowance that is used: clocks and batching differ between the two sides."""


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
