"""The segments of one generation on their way to one client.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from array import array
from bisect import bisect
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from terraport_payload.types import UInt32
from terraport_server.session.id_set import IdSet
from terraport_server.session.selection import Selection
from terraport_wire import ID_DTYPE, Ready, Superseded, Timings

__all__ = ["IdQueue", "Landing", "Transfer"]


class IdQueue:
    """Segment ids in the order in which they are sent: 4 bytes each, a list of ints takes 36.

    Parameters
    ----------
    ids
        First to last.

    Examples
    --------
    >>> queue = IdQueue(np.array([7, 3, 5], dtype=np.uint32))
    >>> queue.popleft()
    >>> queue.insert(1, 9)
    >>> list(queue), queue[0], 7 in queue, len(queue)
    ([3, 9, 5], 3, False, 3)
    """

    __slots__ = ("_first", "_ids")

    def __init__(self, ids: UInt32) -> None:
        self._ids = array("I", ids.tobytes())
        self._first = 0
        """How many are gone."""

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._ids) - self._first

    def __getitem__(self, position: int) -> int:
        """Return one of those that wait, counted from the first; IndexError beyond the last."""
        return self._ids[self._first + position]

    def __iter__(self) -> Iterator[int]:
        """Go through those that wait."""
        ids = self._ids
        for position in range(self._first, len(ids)):
            yield ids[position]

    def __contains__(self, segment: object) -> bool:
        """Tell whether an id waits."""
        return segment in self._ids[self._first :]

    def popleft(self) -> None:
        """Take the first one out."""
        self._first += 1

    def insert(self, position: int, segment: int) -> None:
        """Put an id in before the one that has that position."""
        self._ids.insert(self._first + position, segment)

    def array(self) -> UInt32:
        """Return a copy of those that wait."""
        return np.array(self._ids[self._first :], dtype=np.uint32)


class Transfer:
    """What is still to be sent for one aim or landing, and what was.

    Parameters
    ----------
    generation
        The client's number.
    selection
        The plan; its ``load`` is sent, in order.
    pulled
        Whether the client fetches it by itself (17): nothing is sent but what it rejects.
    """

    def __init__(self, generation: int, selection: Selection, *, pulled: bool = False) -> None:
        self.generation = generation
        self.queue = IdQueue(selection.load[:0] if pulled else selection.load)
        """Ids not yet sent whole; the first may be partly sent."""
        self.awaited: set[int] = set(selection.load.tolist()) if pulled else set()
        """Ids that the client fetches and has not said to hold; none of the queue."""
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
        rank = self._rank(segment)
        position = bisect(self.queue, rank, lo=int(behind_first), key=self._rank)
        self.queue.insert(position, segment)

    @property
    def pending(self) -> bool:
        """Whether anything of the load is not held by the client yet."""
        return bool(self.queue or self.awaited)

    def reject(self, segment: int, partly_sent: Mapping[int, int]) -> None:
        """Queue a segment of the plan once more, if it was not before (6.4, rule 4)."""
        if segment in self.queue or segment in self.resent:
            return
        self.awaited.discard(segment)
        self.resent.add(segment)
        self.put_back(segment, behind_first=bool(self.queue and partly_sent.get(self.queue[0])))

    def fetched(self, ids: Iterable[int]) -> bool:
        """Note what the client holds; tell whether any of it was awaited."""
        taken = self.awaited.intersection(ids)
        self.awaited -= taken
        self.delivered += len(taken)
        return bool(taken)

    def supersede(self, by: int, lengths: UInt32, partly_sent: Mapping[int, int]) -> Superseded:
        """Say that a newer generation ends this one."""
        unsent_bytes = self.unsent_bytes(lengths, partly_sent)
        return Superseded(generation=self.generation, by=by, unsent_bytes=unsent_bytes)

    def unsent_bytes(self, lengths: UInt32, partly_sent: Mapping[int, int]) -> int:
        """Payload bytes that are not sent, given how much of each unfinished segment is."""
        sent_bytes = sum(sent for segment, sent in partly_sent.items() if segment in self.queue)
        unsent_bytes = int(lengths[self.queue.array()].sum(dtype=np.int64)) - sent_bytes
        if self.awaited:
            ids = np.fromiter(self.awaited, dtype=np.int64, count=len(self.awaited))
            unsent_bytes += int(lengths[ids].sum(dtype=np.int64))
        return unsent_bytes

    def _rank(self, segment: int) -> int:
        """Return where in the order a segment of the plan stands: one look at all of it."""
        return int(np.argmax(self._order == segment))


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
    pulled
        As for a transfer.
    """

    def __init__(
        self,
        generation: int,
        selection: Selection,
        *,
        received_s: float,
        deadline_s: float | None = None,
        stall_s: float | None = None,
        pulled: bool = False,
    ) -> None:
        super().__init__(generation, selection, pulled=pulled)
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
        self.deadline_passed = False
        self.degraded = False
        """``degraded`` was said."""
        self.planned_s: float | None = None
        """When the plan was handed to the socket."""
        self.first_byte_s: float | None = None
        """When the first payload byte was sent."""
        self.last_byte_s: float | None = None
        """When the newest payload byte was sent."""
        self.told_s: float | None = None
        """When the client last said to hold something that it was to fetch."""
        self.credit_wait_s = 0.0
        """How long there was payload to send and no credit."""

    @property
    def unfinished(self) -> bool:
        """Whether ``ready`` is still owed."""
        return not self.ready

    @property
    def deadline_s(self) -> float | None:
        """When the inner set alone is acceptable, if nothing more is sent (6.4, rule 3)."""
        times = [] if self._deadline_s is None else [self._deadline_s]
        if self._stall_s is not None:
            progress_s = max(self.received_s, self.last_byte_s or 0.0, self.told_s or 0.0)
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

    def reject(self, segment: int, partly_sent: Mapping[int, int]) -> None:
        """Queue a segment once more, or give it up; what was said to be ready is not."""
        if segment not in self.queue:
            given_up = segment in self.resent
            super().reject(segment, partly_sent)
            (self.missing.add if given_up else self.missing.discard)(segment)
            self.awaited.discard(segment)
            self.ready = False

    def told(self, ids: Iterable[int], now_s: float) -> None:
        """Note what the client holds now: progress, for the deadline, where it was awaited."""
        if self.fetched(ids):
            if self.has_deadline:
                self.look_at_clock(now_s)  # before this counts as progress
            self.told_s = now_s

    def say_ready(self, now_s: float, *, timings: bool) -> Ready:
        """End it: everything is sent, or given up."""
        self.ready = True
        return Ready(
            generation=self.generation,
            delivered=min(self.delivered, len(self.plan)),
            payload_bytes=self.payload_bytes,
            missing=np.array(sorted(self.missing), dtype=ID_DTYPE),
            timings=self.timings(now_s) if timings else None,
        )

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
