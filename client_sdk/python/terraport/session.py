"""A session with a scene, for asyncio.

::

    async with terraport.connect("http://localhost:8080/scenes/quarry", token) as session:
        landing = await session.land((12.0, 3.5, -40.0), radius_m=60)
        async for segment in landing:
            mesh = segment.arrays()

**Contracts.** A session belongs to the event loop on which it was opened. Its coroutines may
overlap in any number; only the newest landing is pursued, older ones that are not ready raise
:class:`~terraport.errors.LandingSupersededError`. Cancelling a coroutine ends that wait and nothing
else. Leaving ``async with`` closes everything: sockets, tasks, what is left to write to disk,
within ``timeouts.close_s``. A lost connection is mended without the caller's doing; what was held
is not sent again.
"""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from terraport import events as core_events
from terraport.address import Access, SceneUrl, Token
from terraport.base import BaseMesh
from terraport.cache import SegmentCache
from terraport.core import SessionCore
from terraport.disk import DEFAULT_DISK_BYTES, DiskCache, DiskWorker
from terraport.errors import (
    GroupError,
    LandingSupersededError,
    OutsideSceneWarning,
    ServerError,
    SessionClosedError,
    TerraportError,
    UsageError,
)
from terraport.group import Group, GroupRecord
from terraport.http import Scales, SceneHttp, scales_of
from terraport.landing import Landing, LandingRecord, faces_of_bits
from terraport.link import Link
from terraport.options import SessionOptions, Timeouts, checked
from terraport.outside import CallerLine, SceneBox
from terraport.places import CoarserPiece, Place
from terraport.version import __version__
from terraport_payload.types import Bool
from terraport_wire import Hit, Join, Limits, Notice, SceneFacts

__all__ = ["DEFAULT_CACHE_BYTES", "Connecting", "Session", "SessionStats", "connect"]

DEFAULT_CACHE_BYTES: Final = 512 << 20
"""Room for several landings of 60 m at full detail."""


@dataclass(frozen=True, slots=True)
class SessionStats:
    """Counters of a session."""

    connections: int
    received_bytes: int
    """Bytes of all WebSocket messages, payload and headers."""
    payload_bytes: int
    """Payload bytes of whole segments that the server sent."""
    prefetched_bytes: int
    """Those of them that came while no landing was open: what aims brought."""
    repeated_bytes: int
    """Those of them that were in memory already; 0 with a right server."""
    rejected: int
    """Segments that came damaged, or that the disk cache had lost."""
    cache_bytes: int
    """Payload bytes in memory now."""


class Session:
    """One scene, open, over as many connections as it takes. Made by :func:`connect`.

    It owns the link, the disk worker and their tasks, and ends them in :meth:`aclose`; a landing or
    group that it handed out ends with it.
    """

    def __init__(
        self,
        core: SessionCore,
        http: SceneHttp,
        url: SceneUrl,
        access: Access,
        timeouts: Timeouts,
        disk: DiskCache | None,
        group: str | None = None,
    ) -> None:
        self._core = core
        self._http = http
        self._url = url
        self._timeouts = timeouts
        self._disk = disk
        self._link = Link(core, url.stream, access, timeouts, self._take, prepare=self._read_scales)
        self._link.group = group
        self._worker = None if disk is None else DiskWorker(disk, core, self._link.pump)
        self._opened: core_events.Opened | None = None
        """The newest connection's welcome."""
        self._welcome: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._failure: TerraportError | None = None
        self._scales: Scales = {}
        self._scales_version: str | None = None
        self._base: BaseMesh | None = None
        self._base_lock = asyncio.Lock()
        self._landings: dict[int, LandingRecord] = {}
        """Landings that are not over."""
        self._picks: dict[int, asyncio.Future[Hit | None]] = {}
        self._group: GroupRecord | None = None
        """The seat that was taken last."""
        self._newest_version: str | None = None
        self._payload_bytes = self._rejected = 0
        # The link's first, then the disk worker's; `aclose` ends them all.
        self._tasks: list[asyncio.Task[None]] = []
        self._hurries: set[asyncio.Task[None]] = set()

    # ---- what is served

    def __repr__(self) -> str:
        """Say which scene it is a session of; never the token."""
        return f"<Session {self.url}>"

    @property
    def scene(self) -> SceneFacts:
        """Id, version, name, segments and base faces, as of the newest connection."""
        return self._welcomed.scene

    @property
    def limits(self) -> Limits:
        """What the server allows, as of the newest connection."""
        return self._welcomed.limits

    @property
    def url(self) -> str:
        """Address of the scene over HTTP."""
        return self._url.http

    @property
    def visible(self) -> tuple[int, ...]:
        """Ids of the segments that the last ready landing shows, ascending.

        Empty before the first, and after a reconnect that found another scene version.
        """
        return self._core.shown.ids

    @property
    def hidden_faces(self) -> Bool:
        """Base faces that are hidden while :attr:`visible` is shown, (B,) bool."""
        return faces_of_bits(self._core.shown.hidden, self.scene.base_faces)

    @property
    def newest_version(self) -> str | None:
        """A newer scene version that the server has announced; served from the next connection."""
        return self._newest_version

    @property
    def stats(self) -> SessionStats:
        """What has been transferred, over all connections."""
        return SessionStats(
            connections=self._link.connections,
            received_bytes=self._link.received_bytes,
            payload_bytes=self._payload_bytes,
            prefetched_bytes=self._core.prefetched_bytes,
            repeated_bytes=self._core.repeated_bytes,
            rejected=self._rejected,
            cache_bytes=self._core.cache_bytes,
        )

    async def visible_set_hash(self) -> str:
        """Return what identifies the picture of the last ready landing: 16 hexadecimal digits.

        It covers the content of the visible segments and the hidden faces of the base mesh: a
        function of the last landing's plan, whatever happened since.
        """
        shown = self._core.shown
        keys = b"".join(key.to_bytes(8, "little") for key in sorted(self._core.shown_keys))
        return hashlib.sha256(keys + shown.hidden).hexdigest()[:16]

    async def manifest(self) -> dict[str, Any]:
        """Return the manifest of the served version (``spec/scene-format.md``, section 4).

        Raises
        ------
        HttpError
            The server does not answer.
        """
        return await self._http.manifest(self.scene.version)

    async def base(self) -> BaseMesh:
        """Return the base mesh, loaded once per scene version.

        May be called from several tasks: one loads, the others wait for it.

        Raises
        ------
        HttpError
            The server does not answer.
        ProtocolViolationError
            What came cannot be decoded.
        """
        async with self._base_lock:
            # A reconnect may lead to another version while the files come: then once more.
            while self._base is None or self._base.version != self.scene.version:
                self._base = await self._http.base(
                    self.scene.version, self._disk, lambda: self._core.needed
                )
            return self._base

    async def places(self) -> tuple[Place, ...]:
        """Return the named regions as places to land at, by name, the largest of each first.

        ``await session.land(place.position, place.radius_m)`` shows it: at its best view where one
        was chosen (:attr:`Place.is_view`), else land on the ground under its middle, which
        :meth:`pick` finds.

        Raises
        ------
        HttpError
            The server does not answer.
        """
        return await self._http.places(self.scene.version)

    async def coarser(self, region: int) -> tuple[CoarserPiece, ...]:
        """Return the coarser pieces that a region is part of, finest first: farm, then valley.

        ``await session.coarser(hit.region)`` goes on from a pick. Regions of engine ``borders``
        have them, those too that people have cut since; others have none.

        Raises
        ------
        HttpError
            The server does not answer.
        """
        return await self._http.coarser(self.scene.version, region)

    # ---- commands

    def land(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        coarse_radius_m: float | None = None,
        inner_radius_m: float | None = None,
        deadline_s: float | None = None,
        stall_s: float | None = None,
        timeout_s: float | None = None,
    ) -> Coroutine[Any, Any, Landing]:
        """Land: ask for everything within a radius, and return when the plan is there.

        The segments follow while the caller goes on. A landing that is not ready is superseded by
        the next one, also when this call is cancelled.

        Parameters
        ----------
        position : sequence of 3 floats
            Metres, scene frame (x east, y up, z south of the origin).
        radius_m : float
            Everything whose box comes within it; the server's ``limits.max_radius_m`` bounds it.
        coarse_radius_m : float, optional
            Beyond `radius_m` everything within this comes at its coarser level, where the scene has
            one (``scene.levels``): a third of the bytes. At least `radius_m`; three times as far is
            a good ring. Cut to the server's ``limits.max_radius_m``.
        inner_radius_m, deadline_s : float, optional
            After `deadline_s` the segments within `inner_radius_m` alone are presentable; see
            :meth:`Landing.presentable`.
        stall_s : float, optional
            So are they after so long without progress; beside `deadline_s` whichever comes first.
            Alone it gives a landing that makes progress all the time it needs.
        timeout_s : float, optional
            Bound on the wait for the plan; the session's ``timeouts.plan_s`` without it.

        Warns
        -----
        OutsideSceneWarning
            The position is farther from the scene than the radius: the landing succeeds, with
            nothing in it. :attr:`Landing.outside_m` says how far. Empty plans alone are looked
            at, by one request over HTTP; where that fails, nothing is said.

        Raises
        ------
        UsageError
            A number that the protocol does not allow, such as a radius that is not above 0.
        ServerError
            The server refuses this landing; an older one that is not ready continues.
        LandingSupersededError
            Another task has landed meanwhile.
        LandingTimeoutError
            No plan in time.
        SessionClosedError
            The session has ended.
        """
        ask = partial(
            self._core.land,
            position,
            radius_m,
            inner_radius_m=inner_radius_m,
            coarse_radius_m=coarse_radius_m,
        )
        for name, patience_s in (("deadline_s", deadline_s), ("stall_s", stall_s)):
            if patience_s is not None and not (patience_s > 0 and inner_radius_m is not None):
                raise UsageError(f"{name} is {patience_s}, expected above 0, with inner_radius_m")
        return self._land(CallerLine.find(), ask, deadline_s, stall_s, timeout_s)

    async def _land(
        self,
        caller: CallerLine,
        ask: Callable[[], int],
        deadline_s: float | None,
        stall_s: float | None,
        timeout_s: float | None,
    ) -> Landing:
        self._require_open()
        number = ask()
        # Nothing is sent before `pump`: the record is there when the first event of it comes.
        record = LandingRecord(number, time.monotonic())
        self._landings[number] = record
        self._link.pump()
        if deadline_s is not None or stall_s is not None:
            hurry = asyncio.create_task(
                self._hurry(record, deadline_s, stall_s), name="terraport-deadline"
            )
            self._hurries.add(hurry)
            hurry.add_done_callback(self._hurries.discard)
        landing = Landing(record)
        plan = await landing.planned(self._timeouts.plan_s if timeout_s is None else timeout_s)
        # Whatever shows something is in the scene: only empty plans are looked at.
        if not (len(plan.show) or plan.omitted_segments):
            record.outside_m = await self._warn_outside(plan.position, plan.radius_m, caller)
        return landing

    async def _hurry(
        self, record: LandingRecord, deadline_s: float | None, stall_s: float | None
    ) -> None:
        """Wait for the deadline, or the end of the landing; then accept the inner set."""
        while not record.is_over:
            ends_s = [] if deadline_s is None else [record.started_s + deadline_s]
            if stall_s is not None:
                ends_s.append(max(record.started_s, self._link.heard_s) + stall_s)
            left_s = min(ends_s) - time.monotonic()
            if left_s <= 0:
                self._core.hurry(record.number)
                self._link.pump()
                return
            await asyncio.sleep(left_s)

    def aim(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        coarse_radius_m: float | None = None,
    ) -> None:
        """Prefetch the segments of a place that the user points at.

        Returns at once; may be called for every frame: at most ten a second are sent, the newest
        always. It never disturbs a landing.

        Raises
        ------
        UsageError
            A number that the protocol does not allow.
        SessionClosedError
            The session has ended.
        """
        self._require_open()
        self._core.aim(position, radius_m, coarse_radius_m)
        self._link.pump()

    async def pick(
        self,
        origin: Sequence[float],
        direction: Sequence[float] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Hit | None:
        """Pick along a ray at full detail, whether its segments are loaded or not.

        Parameters
        ----------
        origin : sequence of 3 floats
            Metres, scene frame.
        direction : sequence of 3 floats, optional
            Of any length; without it, the vertical line through `origin`.
        timeout_s : float, optional
            The session's ``timeouts.pick_s`` without it.

        Returns
        -------
        Hit or None
            Position, normal, segment, region, stable id, label, height and attributes; None for
            nothing. The label is the one that the region has now.

        Raises
        ------
        ServerError
            The server refuses, for example too many picks at once.
        TimeoutError
            No answer in time.
        SessionClosedError
            The session has ended.
        """
        self._require_open()
        request = self._core.pick(origin, direction)
        answer: asyncio.Future[Hit | None] = asyncio.get_running_loop().create_future()
        self._picks[request] = answer
        self._link.pump()
        try:
            async with asyncio.timeout(self._timeouts.pick_s if timeout_s is None else timeout_s):
                return await answer
        finally:
            self._picks.pop(request, None)
            self._core.drop_pick(request)

    async def join_group(
        self,
        group: str,
        *,
        role: str = "member",
        name: str | None = None,
        timeout_s: float | None = 30.0,
    ) -> Group:
        """Take a seat in a group of this scene; a seat held before is left.

        Where the server asks for it, the connection is made anew by a URL that names the group, so
        that a proxy can bring all of it to one server; ``connect(..., group=...)`` spares that.

        Parameters
        ----------
        group : str
            1 to 64 of ``A-Z a-z 0-9 _ . ~ -``.
        role : {"member", "guide"}
            The guide lands the group; there is at most one.
        name : str, optional
            What the others see.
        timeout_s : float or None
            Bound on the wait for the seat.

        Raises
        ------
        UsageError
            A name or role that the protocol does not allow.
        ServerError
            ``group_refused``: no groups here, the group is full or has a guide, or the token does
            not allow to guide.
        TimeoutError
            No answer in time.
        SessionClosedError
            The session has ended.
        """
        self._require_open()
        groups_served, url_group = self.limits.groups, self._link.group
        if groups_served not in {"here", "query"}:
            raise ServerError("group_refused", "no groups are served at this address")
        # By query the URL must name this group; elsewhere it must only not name another.
        allowed = {group} if groups_served == "query" else {None, group}
        reroute = url_group not in allowed
        request = self._core.seat.join(group, role, name)
        if self._group is not None:
            self._group.end(GroupError(f"group {self._group.name} was left"))
        record = GroupRecord(
            group, self._core.seat, land=self.land, pump=self._link.pump, request=request
        )
        # Before anything is sent: the answer is taken by whoever has the seat.
        self._group = record
        if reroute:
            self._link.reroute(group)
        self._link.pump()
        await record.until(lambda: record.member > 0, timeout_s)
        return Group(record)

    async def aclose(self) -> None:
        """Say goodbye and free everything; may be called again. ``async with`` calls it."""
        self._link.leave()
        try:
            async with asyncio.timeout(self._timeouts.close_s):
                # What came is paid for: it is written before the disk is left.
                if self._worker is not None and len(self._tasks) > 1:
                    await self._worker.drained()
                if self._tasks and self._core.is_open:  # else there is nobody to say goodbye to
                    await asyncio.wait(self._tasks[:1])
        except TimeoutError:
            pass  # what is left is cut off
        finally:
            tasks = [*self._tasks, *self._hurries]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._fail(SessionClosedError("it was closed here"))
            await self._http.aclose()

    # ---- events

    def _take(self, event: core_events.Event) -> None:
        """Handle one event of the core completely, so that waiters never see a partial update."""
        if isinstance(event, core_events.SegmentArrived):
            self._arrived(event)
        elif isinstance(event, core_events.Opened):
            self._opened = event
            if not self._welcome.done():  # only the first welcome is waited for
                self._welcome.set_result(None)
        elif isinstance(event, core_events.SegmentRejected):
            self._rejected += 1
            if event.landing in self._landings:
                self._landings[event.landing].rejected += 1
            if event.on_disk and self._worker is not None:
                self._worker.remove(event.key)
        elif isinstance(event, core_events.RestoreNeeded):
            assert self._worker is not None  # only its catalogue knows such segments
            self._worker.restore(event.keys)
        elif isinstance(event, core_events.PickAnswered | core_events.PickRefused):
            answer = self._picks.get(event.request)
            if answer is not None and not answer.done():
                if isinstance(event, core_events.PickAnswered):
                    answer.set_result(event.hit)
                else:
                    answer.set_exception(ServerError(event.code, event.message))
        elif isinstance(event, Notice):
            if event.kind == "scene_published":
                self._newest_version = event.version
        elif isinstance(event, core_events.GroupEvent):
            if self._group is not None:
                self._group.take(event)
        else:
            self._landing_changed(event)

    def _landing_changed(
        self,
        event: core_events.LandingEvent,
    ) -> None:
        record = None if event.landing is None else self._landings.get(event.landing)
        if record is None:
            return
        if isinstance(event, core_events.Planned):
            record.trace.server_session = self._welcomed.session
            record.planned(event, self._scales, self.scene.base_faces)
        elif isinstance(event, core_events.LandingSent):
            record.trace.sent_s = time.monotonic()
        elif isinstance(event, core_events.PayloadBegan):
            record.trace.first_byte_s = time.monotonic()
        elif isinstance(event, core_events.InnerWhole):
            record.inner, record.trace.degraded_s = event, time.monotonic()
            record.changes.changed()
        elif isinstance(event, core_events.Shown):
            record.shown, record.trace.ready_s = event, time.monotonic()
            record.changes.changed()
        elif isinstance(event, core_events.Superseded):
            record.fail(LandingSupersededError(event.landing, event.by))
        else:
            record.fail(ServerError(event.code, event.message))
        if record.is_over:
            del self._landings[record.number]

    def _arrived(self, event: core_events.SegmentArrived) -> None:
        entry = event.entry
        if not event.restored:
            self._payload_bytes += len(entry.payload)
            if self._worker is not None and not self._core.is_on_disk(entry.key):
                self._worker.store(entry)
        if event.landing in self._landings:
            self._landings[event.landing].arrive(event)

    # ---- private

    async def _warn_outside(
        self, position: tuple[float, float, float], radius_m: float, caller: CallerLine
    ) -> float | None:
        """Warn of a place that the scene does not reach; return how far away it is, if so."""
        try:
            box = SceneBox.of(await self.manifest())
        except (TerraportError, KeyError, TypeError, ValueError):
            return None  # a landing does not fail for want of a warning
        distance_m = box.distance_m(position)
        if distance_m <= radius_m:
            return None
        hint = ""
        if box.is_survey_place(position):
            hint = ". As easting, northing and height it is: terraport.frames.to_scene converts"
        elif box.is_above_or_below(position):
            hint = ". Session.pick finds the surface above or below it"
        text = f"landing at {box.explain(position, radius_m)}{hint}"
        caller.warn(text, OutsideSceneWarning)
        return distance_m

    async def open(self) -> None:
        """Connect; called once, by :class:`Connecting`."""
        self._spawn(self._link.run(), "terraport-link")
        if self._worker is not None:
            self._spawn(self._worker.run(), "terraport-disk")
        await self._welcome

    @property
    def _welcomed(self) -> core_events.Opened:
        assert self._opened is not None  # connect() waits for it
        return self._opened

    async def _read_scales(self) -> None:
        """Fetch what decoding needs, once per scene version; a failure shows in decoding alone."""
        version = self.scene.version
        if version == self._scales_version:
            return
        try:
            self._scales = scales_of(await self._http.manifest(version))
            self._scales_version = version
        except TerraportError as error:
            self._scales = error

    def _spawn(self, work: Coroutine[Any, Any, None], name: str) -> None:
        task = asyncio.create_task(work, name=name)
        task.add_done_callback(self._on_task_done)
        self._tasks.append(task)

    def _on_task_done(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if isinstance(error, TerraportError):
            self._fail(error)
        elif error is not None:
            failure = SessionClosedError(f"a fault of the client: {error!r}")
            failure.__cause__ = error
            self._fail(failure)

    def _fail(self, error: TerraportError) -> None:
        """End the session: everyone who waits gets the error."""
        if self._failure is None:
            self._failure = error
        if not self._welcome.done():
            self._welcome.set_exception(error)
            self._welcome.exception()  # nobody waits for it any more once open() was cancelled
        for record in self._landings.values():
            record.fail(error)
        self._landings.clear()
        for answer in self._picks.values():
            if not answer.done():
                answer.set_exception(error)
        self._picks.clear()
        if self._group is not None:
            self._group.end(error)

    def _require_open(self) -> None:
        if self._failure is not None:
            raise SessionClosedError(str(self._failure)) from self._failure


class Connecting:
    """A connection about to be made: ``async with connect(...) as session``."""

    def __init__(self, make: Callable[[], Coroutine[Any, Any, Session]]) -> None:
        self._make = make
        self._session: Session | None = None

    async def open(self) -> Session:
        """Connect without ``async with``; :meth:`Session.aclose` ends it."""
        self._session = await self._make()
        return self._session

    async def __aenter__(self) -> Session:
        return await self.open()

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._session is not None:
            await self._session.aclose()


def connect(
    url: str,
    token: Token = None,
    *,
    max_triangles: int | None = None,
    max_bytes: int | None = None,
    max_segments: int | None = None,
    max_gpu_mebibytes: int | None = None,
    cache_bytes: int = DEFAULT_CACHE_BYTES,
    cache_dir: str | Path | None = None,
    disk_bytes: int = DEFAULT_DISK_BYTES,
    credit_bytes: int = 16 << 20,
    timeouts: Timeouts | None = None,
    group: str | None = None,
) -> Connecting:
    """Connect to a scene: ``async with connect(...) as session``.

    Parameters
    ----------
    url : str
        ``http(s)`` or ``ws(s)``, ending in ``/scenes/ID``; or a server with only one scene.
    token : str or callable, optional
        Bearer token; sent in a header, to that server alone. What is called gives the present one,
        on the event loop and without waiting: then a token that expires is replaced while the
        session goes on.
    max_triangles, max_bytes, max_segments : int, optional
        Hard budgets of every landing: nearest first until the next segment would exceed one.
        Without `max_bytes`, a landing is bounded by `cache_bytes`.
    max_gpu_mebibytes : int, optional
        Likewise, of what a landing takes on a GPU, MiB: what a device that shows it has left for
        one landing.
    cache_bytes : int
        Maximum payload bytes in memory, in addition to what is visible or being received.
    cache_dir : Path, optional
        Keep segments and base meshes there too, from one run to the next. None: memory alone.
    disk_bytes : int
        Bound on everything in `cache_dir`.
    credit_bytes : int
        Payload bytes on their way at most.
    timeouts : Timeouts, optional
        How long to wait for what.
    group : str, optional
        Group that the session will join: named in the address, by which a proxy may bring all of
        it to one server. :meth:`Session.join_group` joins it.

    Returns
    -------
    Connecting
        An async context manager; nothing happens before it is entered, or its ``open()`` awaited.
        That raises

        * :class:`ConnectionFailedError`, :class:`HttpError` when nobody answers (a first connection
          is tried once; a lost one again and again, for ``timeouts.reconnect_s``),
        * :class:`ServerError` when the server refuses, with ``code`` such as ``"unauthorised"`` or
          ``"unknown_scene"``.

    Raises
    ------
    UsageError
        An argument that cannot work.
    """
    if group is not None:
        checked(lambda: Join(request=0, group=group, role="member"))
    options = SessionOptions(
        client=f"terraport-python {__version__}",
        max_triangles=max_triangles,
        max_bytes=cache_bytes if max_bytes is None else max_bytes,
        max_segments=max_segments,
        max_gpu_bytes=None if max_gpu_mebibytes is None else max_gpu_mebibytes << 20,
        credit_bytes=credit_bytes,
    )
    return Connecting(
        partial(
            _connected,
            SceneUrl.parse(url),
            Access(token),
            options,
            timeouts or Timeouts(),
            cache_bytes,
            None if cache_dir is None else Path(cache_dir),
            disk_bytes,
            group,
        )
    )


async def _connected(
    url: SceneUrl,
    access: Access,
    options: SessionOptions,
    timeouts: Timeouts,
    cache_bytes: int,
    cache_dir: Path | None,
    disk_bytes: int,
    group: str | None,
) -> Session:
    http = SceneHttp(url, access, timeouts.http_s)
    try:
        url = await http.resolve()
        disk, on_disk = None, {}
        if cache_dir is not None:
            disk = await asyncio.to_thread(DiskCache, cache_dir, url.key, disk_bytes)
            on_disk = await asyncio.to_thread(disk.catalogue)
        core = SessionCore(options, SegmentCache(cache_bytes), on_disk)
        session = Session(core, http, url, access, timeouts, disk, group)
    except BaseException:
        await http.aclose()
        raise
    try:
        await session.open()
    except BaseException:
        await session.aclose()
        raise
    return session
