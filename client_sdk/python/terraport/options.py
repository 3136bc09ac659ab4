"""Options of a session, checked before anything is sent, and timeouts.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from terraport.errors import UsageError
from terraport_wire import Budgets, Hello, InvalidMessageError, Message

__all__ = ["SessionOptions", "Timeouts", "checked", "point"]

_Message = TypeVar("_Message", bound=Message)


@dataclasses.dataclass(frozen=True, slots=True)
class SessionOptions:
    """What a session tells the server in ``hello``."""

    client: str
    """Name and version of the client, for the server's logs."""
    max_triangles: int | None = None
    max_bytes: int | None = None
    max_segments: int | None = None
    max_gpu_bytes: int | None = None
    """Hard bounds of every landing; None leaves one out. GPU bytes: vertices of 24 bytes, indices
    of 2 or 4, textures with their mips as a device keeps them."""
    credit_bytes: int = 16 * 1024 * 1024
    """Payload bytes under way at most. Half of it is granted back at a time: a larger one saves
    messages, a smaller one bounds what lies in buffers when a landing is superseded."""

    def __post_init__(self) -> None:
        if self.credit_bytes < 1:
            raise UsageError(f"credit_bytes is {self.credit_bytes}, expected 1 or more")
        checked(self.hello)

    def hello(self) -> Hello:
        """Return the message that opens a connection."""
        return Hello(
            client=self.client,
            budgets=Budgets(
                max_triangles=self.max_triangles,
                max_bytes=self.max_bytes,
                max_segments=self.max_segments,
                max_gpu_bytes=self.max_gpu_bytes,
            ),
            credit_bytes=self.credit_bytes,
        )


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


def checked(build: Callable[[], _Message]) -> _Message:
    """Return what `build` makes; a value that the protocol does not allow is the caller's error."""
    try:
        return build()
    except InvalidMessageError as error:
        raise UsageError(str(error)) from None


def point(values: Sequence[float]) -> tuple[float, float, float]:
    """Return three floats, or raise UsageError."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise UsageError(f"position is {values!r}, expected three numbers x, y, z") from None
    if numbers.shape != (3,):
        raise UsageError(f"position has shape {numbers.shape}, expected three numbers x, y, z")
    x, y, z = numbers.tolist()
    return x, y, z
