"""A landing as its user sees it, and the record behind it that the session fills."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace

from terraport.cache import CachedSegment
from terraport.errors import (
    LandingIncompleteError,
    LandingTimeoutError,
    TerraportError,
    UsageError,
)
from terraport.payloads import Scales
from terraport.segment import Segment
from terraport.trace import LandingTrace, SegmentMark
from terraport_wire import Plan

__all__ = ["Landing", "LandingRecord", "LandingStats"]


@dataclass(frozen=True, slots=True)
class LandingStats:
    """What one landing took; times in seconds from the call of ``land``, None while open.

    Bytes are of whole payloads, without frames and messages; each segment counts once, where it
    came from last.
    """

    plan_s: float | None
    first_segment_s: float | None
    """Until the first segment was whole, whether streamed or read from the disk cache."""
    ready_s: float | None
    streamed_segments: int
    streamed_bytes: int
    """Payload bytes of whole segments that the server sent for this landing."""
    memory_bytes: int
    disk_bytes: int
    """Payload bytes that were held before."""
    rejected: int
    """Segments that came with a wrong hash, or that the disk cache had lost."""
    plans: int
    """1, and one more for each reconnect before it was ready."""


@dataclass(slots=True)
class LandingRecord:
    """State of a landing. Filled by the session, on its event loop; read by the landing.

    The session holds it until the landing is over, the landing as long as its user does. Fields
    change only between two awaits, and :meth:`changed` follows every change: whoever wakes sees a
    state that was whole.
    """

    number: int
    clock: Callable[[], float]
    started_s: float
    plan: Plan | None = None
    segments: dict[int, Segment] = field(default_factory=dict)
    """By id: what of the plan is whole."""
    arrived: list[Segment] = field(default_factory=list)
    """In order of arrival, kept ones first; what iteration walks."""
    shown: tuple[int, ...] | None = None
    """Ids once ready."""
    degraded: tuple[int, ...] | None = None
    missing: tuple[int, ...] = ()
    error: TerraportError | None = None
    plan_s: float | None = None
    first_segment_s: float | None = None
    ready_s: float | None = None
    rejected: int = 0
    plans: int = 0
    outside_m: float | None = None
    scales: Scales = field(default_factory=dict)
    """Of the scene version that the plan is of."""
    trace: LandingTrace = field(init=False)
    _waiters: list[asyncio.Future[None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.trace = LandingTrace(self.number, self.started_s)

    @property
    def is_over(self) -> bool:
        """Whether nothing more will happen: it is ready, or has failed."""
        return self.shown is not None or self.error is not None

    def planned(self, plan: Plan, kept: tuple[CachedSegment, ...], scales: Scales) -> None:
        """Take a plan; after a reconnect it replaces the one before."""
        self.plan, self.scales = plan, scales
        self.plans += 1
        now_s, trace = self.clock(), self.trace
        if self.plan_s is None:
            self.plan_s = now_s - self.started_s
        trace.plan_s, trace.generation = now_s, plan.generation
        trace.position, trace.radius_m = plan.position, plan.radius_m
        # What had come before a reconnect is in `kept` now: it keeps its source, and is not given
        # to whoever iterates once more.
        previous_segments, self.segments = self.segments, {}
        for entry in kept:
            previous = previous_segments.get(entry.facts.segment)
            if previous is not None and previous.entry == entry:
                self.segments[previous.id] = replace(previous, scales=scales)
            else:
                self._add(entry, "memory")
        self.changed()

    def arrive(self, entry: CachedSegment, source: str) -> None:
        """Take a whole, verified segment; `source` is ``stream`` or ``disk``."""
        if self.first_segment_s is None:
            self.first_segment_s = self.clock() - self.started_s
        self._add(entry, source)
        self.changed()

    def degrade(self, segments: tuple[int, ...]) -> None:
        """Note that the deadline has passed and these may be shown."""
        self.degraded = segments
        self.trace.degraded_s = self.clock()
        self.changed()

    def ready(self, shown: tuple[int, ...], missing: tuple[int, ...]) -> None:
        """Note that every byte is there: exactly `shown` is to be drawn."""
        self.shown, self.missing = shown, missing
        self.trace.ready_s = self.clock()
        self.ready_s = self.trace.ready_s - self.started_s
        self.changed()

    def fail(self, error: TerraportError) -> None:
        """Note that it will not be ready, and why."""
        # Once ready it stays so: a session that ends takes nothing back.
        if not self.is_over:
            self.error = error
            self.trace.ended_by, self.trace.ended_s = type(error).__name__, self.clock()
            self.changed()

    def changed(self) -> None:
        """Wake everyone who waits."""
        # Exchanged first: who wakes may wait again at once, for the next change.
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def change(self) -> None:
        """Wait until something changes. Any number may wait; cancelling one harms nobody."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def _add(self, entry: CachedSegment, source: str) -> None:
        segment = Segment(entry, source, self.scales)
        self.segments[segment.id] = segment
        self.arrived.append(segment)
        mark = SegmentMark(segment.id, self.clock(), len(entry.payload), source)
        self.trace.segments.append(mark)


class Landing:
    """One landing: its plan is here, its segments are coming.

    Made by :meth:`terraport.Session.land`. It needs no closing: it holds its segments for as long
    as it lives, and a newer landing ends it.

    Every coroutine may be awaited by any number of tasks of the session's loop at once; cancelling
    one ends that wait alone, not the landing.
    """

    def __init__(self, record: LandingRecord) -> None:
        self._record = record

    @property
    def number(self) -> int:
        """1 for the session's first landing, and so on."""
        return self._record.number

    @property
    def plan(self) -> Plan:
        """The server's plan: load, keep, nearby, totals, and what a budget left out.

        What is in `load` and `keep` is to be shown; what is in `nearby` is held, and is not.

        After a reconnect it is the newest one, whose `keep` has what had come before.
        """
        assert self._record.plan is not None  # Session.land waits for it
        return self._record.plan

    @property
    def outside_m(self) -> float | None:
        """Metres from the position to the box around the scene, where that is beyond the radius.

        Then nothing of the scene is there, and :class:`terraport.OutsideSceneWarning` was given.
        None otherwise, also where the base alone is within reach.
        """
        return self._record.outside_m

    @property
    def is_ready(self) -> bool:
        """Whether it is whole (but for :attr:`missing`)."""
        return self._record.shown is not None

    @property
    def missing(self) -> tuple[int, ...]:
        """Ids of the plan that could not be delivered; empty until ready."""
        return self._record.missing

    @property
    def segments(self) -> tuple[Segment, ...]:
        """What of the plan is here, kept segments included, ascending id; once ready, all of it."""
        return tuple(segment for _, segment in sorted(self._record.segments.items()))

    @property
    def stats(self) -> LandingStats:
        """Times, counts and bytes so far."""
        record = self._record
        by_source = {"stream": 0, "memory": 0, "disk": 0}
        streamed = 0
        for segment in record.segments.values():
            by_source[segment.source] += len(segment.payload)
            streamed += segment.source == "stream"
        return LandingStats(
            plan_s=record.plan_s,
            first_segment_s=record.first_segment_s,
            ready_s=record.ready_s,
            streamed_segments=streamed,
            streamed_bytes=by_source["stream"],
            memory_bytes=by_source["memory"],
            disk_bytes=by_source["disk"],
            rejected=record.rejected,
            plans=record.plans,
        )

    @property
    def trace(self) -> LandingTrace:
        """What happened when, here and on the server; for :func:`terraport.write_trace`."""
        return self._record.trace

    def swapped(self) -> None:
        """Note that the application shows this landing from now on, for :attr:`trace`."""
        self._record.trace.swapped_s = self._record.clock()

    async def planned(self, timeout_s: float | None = None) -> Plan:
        """Wait for the plan; :meth:`terraport.Session.land` has done so.

        Raises what :meth:`ready` raises, but for missing segments.
        """
        await self._until(lambda: self._record.plan is not None, timeout_s)
        return self.plan

    async def ready(
        self, timeout_s: float | None = None, *, allow_missing: bool = False
    ) -> tuple[Segment, ...]:
        """Wait until every segment of the plan is here.

        Parameters
        ----------
        timeout_s : float or None
            None waits as long as the session lives; the session's own timeouts bound that.
        allow_missing : bool
            True returns what there is where the server could not deliver some segments.

        Returns
        -------
        tuple of Segment
            Everything that is visible at this landing, ascending id: what lies within its radius,
            or within the plan's ``effective_radius_m`` where a budget cut.

        Raises
        ------
        LandingSupersededError
            A newer landing took its place.
        LandingIncompleteError
            The server could not deliver some segments whole; the others are in :attr:`segments`,
            and over the missing ones the base mesh stays, so nothing is open.
        LandingTimeoutError
            `timeout_s` ran out; the landing goes on, and may be awaited again.
        ServerError
            The server refused it.
        SessionClosedError
            The session ended before.
        """
        await self._until(lambda: self._record.shown is not None, timeout_s)
        if self._record.missing and not allow_missing:
            raise LandingIncompleteError(self.number, self._record.missing)
        return self.segments

    async def presentable(self, timeout_s: float | None = None) -> tuple[Segment, ...]:
        """Wait until there is something whole to show: all, or after the deadline the inner set.

        Meant for landings with ``deadline_s``. Raises what :meth:`ready` raises, but for missing
        segments, which are left out.
        """
        record = self._record
        await self._until(
            lambda: record.shown is not None or record.degraded is not None, timeout_s
        )
        if record.shown is not None or record.degraded is None:
            return self.segments
        return tuple(segment for segment in self.segments if segment.id in record.degraded)

    def __aiter__(self) -> AsyncIterator[Segment]:
        """Iterate over the segments as they arrive: what was held first, then nearest first.

        Ends when the landing is ready, and raises what :meth:`ready` raises. Each loop sees every
        segment once, however often the connection breaks.
        """
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[Segment]:
        record, next_index = self._record, 0
        while True:
            # By index, not by iterator: the list grows while the caller has the segment.
            while next_index < len(record.arrived):
                next_index += 1
                yield record.arrived[next_index - 1]
            if record.is_over:
                await self.ready()  # for its errors: nothing is left to wait for
                return
            await record.change()

    async def _until(self, is_reached: Callable[[], bool], timeout_s: float | None) -> None:
        """Wait until the record is that far, or has failed; what is reached wins over an error."""
        record = self._record
        if timeout_s is not None and not timeout_s >= 0:
            raise UsageError(f"timeout_s is {timeout_s}, expected 0 or more, or None")
        try:
            async with asyncio.timeout(timeout_s):
                while not is_reached():
                    if record.error is not None:
                        raise record.error
                    await record.change()
        except TimeoutError as error:
            # The landing's own error may be a TimeoutError too: it is not this wait's.
            if isinstance(error, TerraportError):
                raise
            expected = 0 if record.plan is None else len(record.plan.load) + len(record.plan.keep)
            raise LandingTimeoutError(
                self.number, timeout_s or 0.0, len(record.segments), expected
            ) from None

    def __repr__(self) -> str:
        plan = self._record.plan
        if plan is None:
            return f"<Landing {self.number}, no plan yet>"
        x, y, z = plan.position
        total = len(plan.load) + len(plan.keep)
        return (
            f"<Landing {self.number} at ({x:g}, {y:g}, {z:g}), {plan.radius_m:g} m: "
            f"{len(self._record.segments)} of {total} segments>"
        )
