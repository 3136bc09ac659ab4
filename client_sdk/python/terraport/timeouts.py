"""How long a session waits for what.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import dataclasses

from terraport.errors import UsageError

__all__ = ["Timeouts"]


@dataclasses.dataclass(frozen=True, slots=True)
class Timeouts:
    """Bounds in seconds; None waits for ever.

    Raises
    ------
    UsageError
        One of them is not above 0.
    """

    connect_s: float | None = 10.0
    """One attempt: TCP, TLS, WebSocket handshake and ``welcome``."""
    reconnect_s: float | None = 120.0
    """All attempts after one loss; then the session ends. Longer survives a server's restart on a
    slow machine; shorter tells a script sooner that nobody is there."""
    plan_s: float | None = 60.0
    """From ``land`` to its plan, reconnecting included."""
    pick_s: float | None = 30.0
    http_s: float | None = 30.0
    """Each wait for more bytes of an HTTP answer."""
    close_s: float = 5.0
    """Saying goodbye and writing what is left to the disk cache."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None and not value > 0:
                raise UsageError(f"{field.name} is {value}, expected above 0")
