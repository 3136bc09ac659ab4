"""Landings and segments: what users hold, and the state that the session fills."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from terraport.errors import (
    LandingIncompleteError,
    LandingTimeoutError,
    TerraportError,
    UsageError,
)
from terraport.events import InnerWhole, Planned, SegmentArrived, Shown
from terraport.http import Scales
from terraport.mesh import to_trimesh
from terraport.trace import LandingTrace, SegmentMark
from terraport_payload import SegmentMesh, decode_segment
from terraport_payload.types import AnyArray, Bool
from terraport_wire import FOLLOWS

if TYPE_CHECKING:
    import trimesh

    from terraport.cache import Box, CachedSegment

__all__ = [
    "Changes",
    "Landing",
    "LandingFacts",
    "LandingPlan",
    "LandingRecord",
    "LandingStats",
    "Segment",
    "faces_of_bits",
]


@dataclass(frozen=True, slots=True)
class Segment:
    """A payload whose checksums are right, not decoded yet. Immutable; any thread may use it."""

    id: int
    """Unique in one scene version: the segment's number, at the coarser level that plus
    ``scene.segment_count``."""
    faces: int
    """Number of triangles."""
    vertices: int
    """Number of vertices."""
    entry: CachedSegment
    source: str
    """``"stream"``: sent for this landing; ``"memory"``, ``"disk"``: held before."""
    scales: Scales
    """Of the scene version's attributes, as its manifest has them."""

    def __repr__(self) -> str:
        """Say what the plan says of it, and where it came from."""
        size = f"{self.faces:,} faces, {self.vertices:,} vertices, {len(self.payload):,} bytes"
        return f"<Segment {self.id}: {size}, from {self.source}>"

    @property
    def key(self) -> int:
        """Names the payload by its content, in any version of the scene."""
        return self.entry.key

    @property
    def payload(self) -> bytes:
        """The bytes as the server sent them: segment format 2 (``spec/segment-format.md``).

        :func:`terraport.write_glb` writes :meth:`arrays` as a file that viewers open.
        """
        return self.entry.payload

    @property
    def bounds(self) -> Box:
        """Min x, y, z, max x, y, z in metres, scene frame."""
        return self.entry.box

    def arrays(self) -> SegmentMesh:
        """Decode to NumPy arrays; every call decodes again (about 2 ms for 10 k faces).

        Raises
        ------
        terraport_payload.PayloadError
            The payload is not a whole segment.
        HttpError
            The scene's manifest, which says what attributes mean, could not be fetched when the
            connection was made.
        """
        if isinstance(self.scales, TerraportError):
            raise self.scales
        return decode_segment(self.payload, scales=self.scales)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Decode to a trimesh; attributes in ``vertex_attributes``.

        Raises what :meth:`arrays` raises.

        Raises
        ------
        MissingExtraError
            trimesh is not installed.
        """
        return to_trimesh(self.arrays())


@dataclass(frozen=True, slots=True, eq=False)
class LandingPlan:
    """What the server decided: what is shown, and what of it follows."""

    generation: int
    """With the server's session, the landing's id in its log."""
    position: tuple[float, float, float]
    """Metres, scene frame."""
    radius_m: float
    effective_radius_m: float
    """Everything nearer is in `show`: the radius asked for, or less where a budget cut."""
    show: AnyArray
    """Segments that are shown, nearest first: rows of key, id (as :attr:`Segment.id`), bytes,
    faces, vertices, flags."""
    omitted_segments: int
    """Segments that a budget left out."""
    omitted_by: str | None
    """The budget: ``max_triangles``, ``max_bytes``, ``max_segments`` or ``max_gpu_bytes``."""

    @property
    def load(self) -> AnyArray:
        """Rows of `show` that were not held when the landing was sent."""
        rows: AnyArray = self.show[(self.show["flags"] & FOLLOWS) > 0]
        return rows

    @property
    def keep(self) -> AnyArray:
        """Rows of `show` that were held."""
        rows: AnyArray = self.show[(self.show["flags"] & FOLLOWS) == 0]
        return rows

    @property
    def load_bytes(self) -> int:
        """Payload bytes of `load`."""
        return _sum(self.load["bytes"])

    @property
    def load_triangles(self) -> int:
        """Triangles of `load`."""
        return _sum(self.load["faces"])

    @property
    def total_bytes(self) -> int:
        """Payload bytes of all that is shown."""
        return _sum(self.show["bytes"])

    @property
    def total_triangles(self) -> int:
        """Triangles of all that is shown."""
        return _sum(self.show["faces"])


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
    """Segments that came damaged, or that the disk cache had lost."""
    plans: int
    """1, and one more for each time that the landing was sent again."""


class Changes:
    """Wakes who waits for a change. Fields change only between two awaits."""

    def __init__(self) -> None:
        self._waiters: list[asyncio.Future[None]] = []

    def changed(self) -> None:
        """Wake everyone who waits."""
        # Exchanged first: who wakes may wait again at once, for the next change.
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def change(self) -> None:
        """Wait for the next change. Any number may wait; cancelling one harms nobody."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    async def until(
        self,
        is_reached: Callable[[], bool],
        error: Callable[[], Exception | None],
        timeout_s: float | None,
    ) -> None:
        """Wait until something is reached, which wins over an error; raise it, or TimeoutError."""
        if timeout_s is not None and not timeout_s >= 0:
            raise UsageError(f"timeout_s is {timeout_s}, expected 0 or more, or None")
        async with asyncio.timeout(timeout_s):
            while not is_reached():
                failure = error()
                if failure is not None:
                    raise failure
                await self.change()


@dataclass(slots=True)
class LandingRecord:
    """State of a landing. Filled by the session, on its event loop; read by the landing.

    :meth:`Changes.changed` follows every change: whoever wakes sees a state that was whole.
    """

    number: int
    started_s: float
    plan: LandingPlan | None = None
    segments: dict[int, Segment] = field(default_factory=dict)
    """By id: what of the plan is whole."""
    arrived: list[Segment] = field(default_factory=list)
    """In order of arrival, held ones first; what iteration walks."""
    inner: InnerWhole | None = None
    shown: Shown | None = None
    error: TerraportError | None = None
    first_segment_s: float | None = None
    rejected: int = 0
    plans: int = 0
    outside_m: float | None = None
    scales: Scales = field(default_factory=dict)
    base_faces: int = 0
    trace: LandingTrace = field(init=False)
    changes: Changes = field(default_factory=Changes)

    def __post_init__(self) -> None:
        self.trace = LandingTrace(self.number, self.started_s)

    @property
    def is_over(self) -> bool:
        """Whether nothing more will happen: it is ready, or has failed."""
        return self.shown is not None or self.error is not None

    def planned(self, event: Planned, scales: Scales, base_faces: int) -> None:
        """Take a plan; when the landing is sent again it replaces the one before."""
        plan, land = event.plan, event.land
        self.plan = LandingPlan(
            generation=plan.generation,
            position=land.position,
            radius_m=land.radius_m,
            effective_radius_m=plan.effective_radius_m,
            show=plan.show,
            omitted_segments=plan.omitted,
            omitted_by=plan.omitted_by,
        )
        self.scales, self.base_faces = scales, base_faces
        self.plans += 1
        trace = self.trace
        trace.plan_s = trace.plan_s or time.monotonic()
        trace.generation = plan.generation
        trace.position, trace.radius_m = land.position, land.radius_m
        # What has come before keeps its source, and is not given once more to whoever iterates.
        source = {segment.key: segment.source for segment in self.segments.values()}
        self.segments = {}
        for entry in event.here:
            if entry.key in source:
                again = self._segments(entry, source[entry.key])
                self.segments |= {segment.id: segment for segment in again}
            else:
                self._add(entry, "stream" if entry.key in event.came else "memory")
        self.changes.changed()

    def arrive(self, event: SegmentArrived) -> None:
        """Take a segment that the plan shows."""
        if self.first_segment_s is None:
            self.first_segment_s = time.monotonic() - self.started_s
        self._add(event.entry, "disk" if event.restored else "stream")
        self.changes.changed()

    def fail(self, error: TerraportError) -> None:
        """Note that it will not be ready, and why."""
        # Once ready it stays so: a session that ends takes nothing back.
        if not self.is_over:
            self.error = error
            self.trace.ended_by, self.trace.ended_s = type(error).__name__, time.monotonic()
            self.changes.changed()

    def _add(self, entry: CachedSegment, source: str) -> None:
        for segment in self._segments(entry, source):
            self.segments[segment.id] = segment
            self.arrived.append(segment)
            mark = SegmentMark(segment.id, time.monotonic(), len(entry.payload), source)
            self.trace.segments.append(mark)

    def _segments(self, entry: CachedSegment, source: str) -> list[Segment]:
        """Return what the plan has of a payload: one segment, as a rule."""
        assert self.plan is not None
        rows = self.plan.show[self.plan.show["key"] == entry.key].tolist()
        return [
            Segment(number, faces, vertices, entry, source, self.scales)
            for _, number, _, faces, vertices, _ in rows
        ]


class LandingFacts:
    """What is known of a landing now; its waiting methods are those of its subclasses."""

    def __init__(self, record: LandingRecord) -> None:
        self.record = record

    @property
    def number(self) -> int:
        """1 for the session's first landing, and so on."""
        return self.record.number

    @property
    def plan(self) -> LandingPlan:
        """The server's plan: what is shown, what of it follows, and what a budget left out.

        After a reconnect it is the newest one, whose `keep` has what had come before.
        """
        assert self.record.plan is not None  # Session.land waits for it
        return self.record.plan

    @property
    def outside_m(self) -> float | None:
        """Metres from the position to the box around the scene, where that is beyond the radius.

        Then nothing of the scene is there, and :class:`terraport.OutsideSceneWarning` was given.
        None otherwise, also where the base alone is within reach.
        """
        return self.record.outside_m

    @property
    def is_ready(self) -> bool:
        """Whether it is whole (but for :attr:`missing`)."""
        return self.record.shown is not None

    @property
    def missing(self) -> tuple[int, ...]:
        """Ids of segments that could not be delivered; empty until ready."""
        return () if self.record.shown is None else self.record.shown.missing

    @property
    def segments(self) -> tuple[Segment, ...]:
        """What of the plan is here, held segments included, ascending id; once ready, all of it."""
        return tuple(segment for _, segment in sorted(self.record.segments.items()))

    @property
    def hidden_faces(self) -> Bool:
        """Base faces that are hidden when this landing is shown, (B,) bool.

        While only the inner set is presentable, those that are hidden with it; none before.
        """
        record = self.record
        event = record.shown or record.inner
        return faces_of_bits(b"" if event is None else event.hidden, record.base_faces)

    @property
    def stats(self) -> LandingStats:
        """Times, counts and bytes so far."""
        record, trace = self.record, self.record.trace
        by_source = {"stream": 0, "memory": 0, "disk": 0}
        streamed = 0
        for segment in record.segments.values():
            by_source[segment.source] += len(segment.payload)
            streamed += segment.source == "stream"
        return LandingStats(
            plan_s=None if trace.plan_s is None else trace.plan_s - record.started_s,
            first_segment_s=record.first_segment_s,
            ready_s=None if trace.ready_s is None else trace.ready_s - record.started_s,
            streamed_segments=streamed,
            streamed_bytes=by_source["stream"],
            memory_bytes=by_source["memory"],
            disk_bytes=by_source["disk"],
            rejected=record.rejected,
            plans=record.plans,
        )

    @property
    def trace(self) -> LandingTrace:
        """What happened when; for :func:`terraport.write_trace`."""
        return self.record.trace

    def swapped(self) -> None:
        """Note that the application shows this landing from now on, for :attr:`trace`."""
        self.record.trace.swapped_s = time.monotonic()

    def __repr__(self) -> str:
        plan = self.record.plan
        if plan is None:
            return f"<Landing {self.number}, no plan yet>"
        x, y, z = plan.position
        return (
            f"<Landing {self.number} at ({x:g}, {y:g}, {z:g}), {plan.radius_m:g} m: "
            f"{len(self.record.segments)} of {len(plan.show)} segments>"
        )


class Landing(LandingFacts):
    """One landing: its plan is here, its segments are coming.

    Made by :meth:`terraport.Session.land`. It needs no closing: it holds its segments for as long
    as it lives, and a newer landing ends it.

    Every coroutine may be awaited by any number of tasks of the session's loop at once; cancelling
    one ends that wait alone, not the landing.
    """

    async def planned(self, timeout_s: float | None = None) -> LandingPlan:
        """Wait for the plan; :meth:`terraport.Session.land` has done so.

        Raises what :meth:`ready` raises, but for missing segments.
        """
        await self._until(lambda: self.record.plan is not None, timeout_s)
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
            `timeout_s` ran out; the landing continues, and may be awaited again.
        ServerError
            The server refused it.
        SessionClosedError
            The session ended before.
        """
        await self._until(lambda: self.record.shown is not None, timeout_s)
        if self.missing and not allow_missing:
            raise LandingIncompleteError(self.number, self.missing)
        return self.segments

    async def presentable(self, timeout_s: float | None = None) -> tuple[Segment, ...]:
        """Wait until there is something whole to show: all, or after the deadline the inner set.

        Meant for landings with ``deadline_s``. Raises what :meth:`ready` raises, but for missing
        segments, which are left out.
        """
        record = self.record
        await self._until(lambda: record.shown is not None or record.inner is not None, timeout_s)
        if record.shown is not None or record.inner is None:
            return self.segments
        return tuple(segment for segment in self.segments if segment.id in record.inner.ids)

    def __aiter__(self) -> AsyncIterator[Segment]:
        """Iterate over the segments as they arrive: what was held first, then nearest first.

        Ends when the landing is ready, and raises what :meth:`ready` raises. Each loop sees every
        segment once, however often the connection breaks.
        """
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[Segment]:
        record, next_index = self.record, 0
        while True:
            # By index, not by iterator: the list grows while the caller has the segment.
            while next_index < len(record.arrived):
                next_index += 1
                yield record.arrived[next_index - 1]
            if record.is_over:
                await self.ready()  # for its errors: nothing is left to wait for
                return
            await record.changes.change()

    async def _until(self, is_reached: Callable[[], bool], timeout_s: float | None) -> None:
        record = self.record
        try:
            await record.changes.until(is_reached, lambda: record.error, timeout_s)
        except TimeoutError as error:
            # The landing's own error may be a TimeoutError too: it is not this wait's.
            if isinstance(error, TerraportError):
                raise
            expected = 0 if record.plan is None else len(record.plan.show)
            raise LandingTimeoutError(
                self.number, timeout_s or 0.0, len(record.segments), expected
            ) from None


def faces_of_bits(bits: bytes, count: int) -> Bool:
    """Return packed hidden faces as (count,) bool; none where there are no bits yet."""
    if not bits:
        return np.zeros(count, dtype=np.bool_)
    octets = np.frombuffer(bits, np.uint8)
    return np.unpackbits(octets, count=count, bitorder="little").astype(np.bool_)


def _sum(counts: Any) -> int:
    return int(counts.sum(dtype=np.uint64))
