"""What is held, told to a server in messages that it takes.

PURE: no I/O, no clock. ``spec/wire-protocol.md``, section 5, rule 3.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_wire import (
    HELD_DTYPE,
    MAX_HELD_SEGMENTS,
    Held,
    Welcome,
)

__all__ = ["HeldOffer"]

_AROUND: Final = 64
"""Room for what stands around the table in its message."""


class HeldOffer:
    """One offer: as much as ``hello`` takes, and the rest after the welcome."""

    __slots__ = ("_rest",)

    def __init__(self) -> None:
        self._rest: AnyArray = np.zeros(0, dtype=HELD_DTYPE)

    def first(self, rows: AnyArray, *, in_hello: bool) -> AnyArray:
        """Return what goes into ``hello``.

        Parameters
        ----------
        rows : ndarray
            Everything that is held, most wanted first.
        in_hello : bool
            False: nothing, because the server found it too large; all of it goes after the
            welcome, which says how large a message may be.
        """
        count = MAX_HELD_SEGMENTS if in_hello else 0
        self._rest = rows[count:]
        return rows[:count]

    def rest(self, welcome: Welcome) -> tuple[list[Held], list[int]]:
        """Return, once, the messages that go after the welcome.

        And the ids that a server which takes no table cannot be told of.
        """
        rows, self._rest = self._rest, self._rest[:0]
        limits = welcome.limits
        most = (limits.max_message_bytes - _AROUND) // HELD_DTYPE.itemsize
        most = min(most, limits.max_held_segments)
        if most < 1:
            return [], rows["id"].tolist()
        return [Held(segments=rows[at : at + most]) for at in range(0, len(rows), most)], []
