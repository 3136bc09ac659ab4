"""A bound on messages per second, averaged over a window.

PURE: no I/O, no clock.
"""

from __future__ import annotations

__all__ = ["HELD_ROWS_PER_MESSAGE", "RATE_WINDOW_S", "RateLimit", "RatesByName"]

HELD_ROWS_PER_MESSAGE = 4096
"""So many rows of a ``held`` count as another message: they are looked at one by one."""

RATE_WINDOW_S = 10.0
"""Messages per second are averaged over this time (spec/wire-protocol.md, section 12)."""

_MAX_NAMES = 1000


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

    @property
    def broken_text(self) -> str:
        """What whoever goes beyond it is told."""
        window = f"{self.per_s:g} per second in {RATE_WINDOW_S:g} s"
        return f"got more messages than {window}, expected fewer"

    def take(self, now_s: float, count: int = 1) -> bool:
        """Take so many tokens; ``False``, and none taken, when there are fewer."""
        gained = max(0.0, now_s - self._filled_s) * self.per_s
        self._tokens = min(self._most, self._tokens + gained)
        self._filled_s = max(self._filled_s, now_s)
        if self._tokens < count:
            return False
        self._tokens -= count
        return True


class RatesByName:
    """The same rate for each of many names, of which the last to come are remembered.

    Parameters
    ----------
    per_s
        Messages per second of each.

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
        """Take one of a name; ``False`` where it has none left."""
        limit = self._of.pop(name, None) or RateLimit(self.per_s, now_s=now_s)
        self._of[name] = limit
        if len(self._of) > _MAX_NAMES:
            del self._of[next(iter(self._of))]
        return limit.take(now_s)
