"""What the caller says, checked before anything is sent.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from terraport.errors import UsageError
from terraport.payloads import ENCODING
from terraport_payload.types import AnyArray
from terraport_wire import (
    HELD_DTYPE,
    PROTOCOL,
    Budgets,
    Hello,
    InvalidMessageError,
    Message,
)

__all__ = ["SessionOptions", "checked", "point"]

_Message = TypeVar("_Message", bound=Message)


@dataclass(frozen=True, slots=True)
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
    messages (the server allows 60 per second), a smaller one bounds what lies in buffers when a
    landing is superseded."""
    release_factor: float | None = None
    """Within so many radii of a landing what is held is kept beside what is shown, so that a hop
    back costs no bytes; None takes the server's."""

    pull: bool = False
    """Whether to fetch payload over HTTP, where the server offers that; else it comes in frames."""

    def __post_init__(self) -> None:
        if self.credit_bytes < 1:
            raise UsageError(f"credit_bytes is {self.credit_bytes}, expected 1 or more")
        checked(lambda: self.hello(np.zeros(0, dtype=HELD_DTYPE)))

    def hello(self, held: AnyArray, *, pull: bool = False) -> Hello:
        """Return the message that opens a connection."""
        return Hello(
            protocol=PROTOCOL,
            client=self.client,
            encoding=ENCODING,
            budgets=Budgets(
                max_triangles=self.max_triangles,
                max_bytes=self.max_bytes,
                max_segments=self.max_segments,
                max_gpu_bytes=self.max_gpu_bytes,
            ),
            credit_bytes=self.credit_bytes,
            release_factor=self.release_factor,
            held=held,
            delivery="pull" if pull else None,
            timings=True,
        )


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
