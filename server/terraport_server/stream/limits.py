"""Limits on open sessions: in total and per client address, with a reserve for new addresses."""

from __future__ import annotations

from collections import Counter
from typing import Final

__all__ = ["RESERVED_SHARE", "SessionCounts"]

RESERVED_SHARE: Final = 8
"""The last eighth of all sessions is reserved for addresses that hold fewer than are left, so that
ten addresses that take all they may do not keep others out."""


class SessionCounts:
    """Open sessions by client address.

    Parameters
    ----------
    max_sessions, max_sessions_per_ip
        The settings of these names; the reserve exists only if the second is lower.

    Examples
    --------
    >>> counts = SessionCounts(16, 4)
    >>> [counts.add("192.0.2.1") for _ in range(4)]
    [None, None, None, None]
    >>> counts.add("192.0.2.1")
    ('sessions_per_ip', 'got session 5 from one address, expected at most 4')
    """

    def __init__(self, max_sessions: int, max_sessions_per_ip: int) -> None:
        self._max_sessions = max_sessions
        self._max_per_ip = max_sessions_per_ip
        self._counts: Counter[str] = Counter()

    def __len__(self) -> int:
        """Return the number of open sessions."""
        return self._counts.total()

    def refusal(self, client: str) -> tuple[str, str] | None:
        """Return why a client cannot open a session: kind (for metrics) and text; or None."""
        most, total, held = self._max_sessions, len(self), self._counts[client]
        if total >= most:
            return "sessions", f"got session {total + 1}, expected at most {most}"
        if held >= self._max_per_ip:
            text = f"got session {held + 1} from one address, expected at most {self._max_per_ip}"
            return "sessions_per_ip", text
        left = most - total
        if self._max_per_ip < most and left <= most // RESERVED_SHARE and held >= left:
            text = f"got session {held + 1} from one address where {left} are left"
            return "sessions_per_ip", f"{text}, expected fewer than are left"
        return None

    def add(self, client: str) -> tuple[str, str] | None:
        """Count a session, unless there is a :meth:`refusal`, which is returned."""
        refusal = self.refusal(client)
        if refusal is None:
            self._counts[client] += 1
        return refusal

    def remove(self, client: str) -> None:
        """Remove a session from the counts."""
        self._counts[client] -= 1
        if self._counts[client] <= 0:
            del self._counts[client]
