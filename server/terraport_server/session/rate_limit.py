"""Token buckets: limits on messages per second, averaged over a window.

PURE: no I/O, no clock.
"""

from __future__ import annotations

__all__ = ["RATE_WINDOW_S", "RateLimit", "RatesByName"]

RATE_WINDOW_S = 10.0
"""Seconds over which the rate is averaged (spec/protocol.md, section 9)."""

_MAX_NAMES = 1000


class RateLimit:
    """Token bucket with a capacity of ``RATE_WINDOW_S`` times the rate.

    Parameters
    ----------
    per_s
        Messages per second.
    now_s
        Current time; the bucket starts full.

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

    @property
    def broken_text(self) -> str:
        """Error text for a client over the limit."""
        window = f"{self.per_s:g} per second in {RATE_WINDOW_S:g} s"
        return f"got more messages than {window}, expected fewer"

    def take(self, now_s: float) -> bool:
        """Take a token; return ``False`` if there is none."""
        gained = max(0.0, now_s - self._filled_s) * self.per_s
        self._tokens = min(self._most, self._tokens + gained)
        self._filled_s = max(self._filled_s, now_s)
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True


class RatesByName:
    """Token buckets by name, all with the same rate; only the most recent names are kept.

    Parameters
    ----------
    per_s
        Messages per second per name.

    Examples
    --------
    >>> rates = RatesByName(0.1)
    >>> rates.take("anna", 0.0), rates.take("anna", 1.0), rates.take("ben", 1.0)
    (True, False, True)
    """

    def __init__(self, per_s: float) -> None:
        self.per_s = per_s
        self._of: dict[str, RateLimit] = {}

    def take(self, name: str, now_s: float) -> bool:
        """Take one token of a name; return ``False`` if it has none left."""
        limit = self._of.pop(name, None) or RateLimit(self.per_s, now_s=now_s)
        self._of[name] = limit
        if len(self._of) > _MAX_NAMES:
            del self._of[next(iter(self._of))]
        return limit.take(now_s)
