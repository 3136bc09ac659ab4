"""The segments of one generation on their way to one client.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from bisect import bisect
from collections import deque
from collections.abc import Mapping

import numpy as np

from terraport_payload.types import UInt32
from terraport_server.id_set import IdSet
from terraport_server.selection import Selection
from terraport_wire import Timings

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
        self.generation = generation
        self.queue: deque[int] = deque(selection.load.tolist())
        """Ids not yet sent whole; the first may be partly sent."""
        self.plan = IdSet.of_sorted(np.sort(selection.load))
        """Ids that this generation answers for."""
        self._order = selection.order
        self.delivered = 0
        """Segments sent whole."""
        self.payload_bytes = 0
        """Chunk bytes sent, repeated ones included."""
        self.resent: set[int] = set()
        """Segments sent once more after a reject."""

    def put_back(self, segment: int, *, behind_first: bool) -> None:
        """Queue a segment of the plan that is to be sent once more, at its place in the order.

        Parameters
        ----------
        segment
            Not in the queue.
        behind_first
            Whether the first one in the queue is partly sent: it goes on before anything else.
        """
        ranks = dict(zip(self._order.tolist(), range(len(self._order)), strict=True))
        position = bisect(self.queue, ranks[segment], lo=int(behind_first), key=ranks.__getitem__)
        self.queue.insert(position, segment)

    def unsent_bytes(self, lengths: UInt32, partly_sent: Mapping[int, int]) -> int:
        """Payload bytes that are not sent, given how much of each unfinished segment is."""
        unsent = np.fromiter(self.queue, dtype=np.int64, count=len(self.queue))
        sent = (
            sum(partly_sent[segment] for segment in partly_sent.keys() & set(self.queue))
            if partly_sent
            else 0
        )
        return int(lengths[unsent].sum(dtype=np.int64)) - sent


class Landing(Transfer):
    """A :class:`Transfer` with a kept part, a deadline and an end.

    Parameters
    ----------
    generation, selection
        As for a transfer.
    received_s
        When ``land`` came, on the session's clock.
    deadline_s
        When the inner set alone is acceptable, whatever comes; ``None`` = never.
    stall_s
        Seconds without progress after which it is; ``None`` = however long it stands still.
    """

    def __init__(
        self,
        generation: int,
        selection: Selection,
        *,
        received_s: float,
        deadline_s: float | None = None,
        stall_s: float | None = None,
    ) -> None:
        super().__init__(generation, selection)
        self.plan = selection.plan
        self.received_s = received_s
        self._deadline_s = deadline_s
        self._stall_s = stall_s
        self.has_deadline = deadline_s is not None or stall_s is not None
        self.inner = selection.inner
        """Ids of the declared degraded set, nearest first."""
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
    def deadline_s(self) -> float | None:
        """When the inner set alone is acceptable, if nothing more is sent (6.4, rule 3)."""
        times = [] if self._deadline_s is None else [self._deadline_s]
        if self._stall_s is not None:
            progress_s = self.received_s if self.last_byte_s is None else self.last_byte_s
            times.append(progress_s + self._stall_s)
        return min(times, default=None)

    @property
    def deadline_is_open(self) -> bool:
        """Whether a deadline may still bring ``degraded``."""
        return self.has_deadline and self.unfinished and not self.degraded

    def look_at_clock(self, now_s: float) -> bool:
        """Return whether a deadline has passed, now or before; what has passed stays passed."""
        due_s = self.deadline_s
        self.deadline_passed = self.deadline_passed or (due_s is not None and now_s >= due_s)
        return self.deadline_passed

    def timings(self, now_s: float) -> Timings:
        """Return when what was done, for a landing that becomes ready now (6.4, rule 8)."""

        def since_us(moment_s: float | None) -> int | None:
            if moment_s is None:
                return None
            return max(0, round((moment_s - self.received_s) * 1e6))

        return Timings(
            plan_us=since_us(self.planned_s),
            first_byte_us=since_us(self.first_byte_s),
            last_byte_us=since_us(self.last_byte_s),
            ready_us=since_us(now_s) or 0,
            credit_wait_us=max(0, round(self.credit_wait_s * 1e6)),
        )

    def inner_is_whole(self, held: IdSet) -> bool:
        """Whether the client holds all of the inner set that can be delivered."""
        inner = self.inner
        return all(segment in self.missing for segment in inner[~held.contains(inner)].tolist())
