"""The segments of one generation on their way to one client.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from terraport_server.selection import Selection

__all__ = ["Landing", "Transfer"]


class Transfer:
    """What is still to be sent for one aim or landing, and what was.

    Parameters
    ----------
    generation
        The client's number.
    selection
        The plan; its ``load`` is sent, in order.
    """

    def __init__(self, generation: int, selection: Selection) -> None:
        load = selection.load.tolist()
        self.generation = generation
        self.queue: deque[int] = deque(load)
        """Ids not yet sent whole; the first may be partly sent."""
        self.plan: frozenset[int] = frozenset(load)
        """Ids that this generation answers for."""
        self.delivered = 0
        """Segments sent whole."""
        self.payload_bytes = 0
        """Chunk bytes sent, repeated ones included."""
        self.resent: set[int] = set()
        """Segments sent once more after a reject."""

    def unsent_bytes(self, lengths: npt.NDArray[np.uint32], parts: Mapping[int, int]) -> int:
        """Payload bytes that are not sent, given how much of each unfinished segment is."""
        return sum(int(lengths[segment]) - parts.get(segment, 0) for segment in self.queue)


class Landing(Transfer):
    """A :class:`Transfer` with a kept part, a deadline and an end.

    Parameters
    ----------
    generation, selection
        As for a transfer.
    received_s
        When ``land`` came, on the session's clock.
    deadline_s
        When the inner set alone is acceptable; ``None`` = never.
    """

    def __init__(
        self, generation: int, selection: Selection, *, received_s: float, deadline_s: float | None
    ) -> None:
        super().__init__(generation, selection)
        self.plan |= frozenset(selection.keep.tolist())
        self.received_s = received_s
        self.deadline_s = deadline_s
        self.inner: list[int] = selection.inner.tolist()
        self.missing: set[int] = set()
        """Segments of the plan that cannot be delivered."""
        self.ready = False
        """``ready`` was said, and nothing was rejected since."""
        self.readied = False
        """``ready`` was said at least once."""
        self.superseded = False
        self.deadline_passed = False
        self.degraded = False
        """``degraded`` was said."""
        self.planned_s: float | None = None
        """When the plan was handed to the socket."""
        self.first_byte_s: float | None = None
        """When the first payload byte was sent."""
        self.last_byte_s: float | None = None
        """When the newest payload byte was sent."""
        self.credit_wait_s = 0.0
        """How long there was payload to send and no credit."""

    @property
    def unfinished(self) -> bool:
        """Whether ``ready`` is still owed."""
        return not self.ready and not self.superseded

    @property
    def deadline_is_open(self) -> bool:
        """Whether the deadline may still bring ``degraded``."""
        return self.deadline_s is not None and self.unfinished and not self.degraded

    def inner_is_whole(self, held: npt.NDArray[np.bool_]) -> bool:
        """Whether the client holds all of the inner set that can be delivered."""
        return all(held[segment] or segment in self.missing for segment in self.inner)
