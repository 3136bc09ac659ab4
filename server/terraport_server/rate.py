"""A bound on messages per second, averaged over a window.

PURE: no I/O, no clock.
"""

from __future__ import annotations

__all__ = ["RATE_WINDOW_S", "RateLimit"]

RATE_WINDOW_S = 10.0
"""Messages per second are averaged over this time (spec/wire-protocol.md, section 12)."""


class RateLimit:
    """A bucket of tokens that holds ``RATE_WINDOW_S`` of the rate and fills at the rate.

    Parameters
    ----------
    per_s
        Messages per second.
    now_s
        Time now; the bucket begins full.

    Examples
    --------
    >>> limit = RateLimit(0.2, now_s=0.0)
    >>> [limit.take(0.0), limit.take(0.0), limit.take(0.0), limit.take(5.0)]
    [True, True, False, True]
    """

    def __init__(self, per_s: float, *, now_s: float) -> None:
        self.per_s = per_s
        self._most = max(1.0, RATE_WINDOW_S * per_s)
        self._tokens = self._most
        self._filled_s = now_s

    def take(self, now_s: float) -> bool:
        """Take one token; ``False`` when there is none."""
        gained = max(0.0, now_s - self._filled_s) * self.per_s
        self._tokens = min(self._most, self._tokens + gained)
        self._filled_s = max(self._filled_s, now_s)
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
