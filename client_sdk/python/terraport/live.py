"""A session with a scene, open: what its user may ask for, and how long it lives.

It puts the state machine, its connection, its disk and its HTTP together; what comes back is
carried out by :mod:`terraport.intake`. :func:`terraport.connect` makes it and says what may be
called when.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Sequence
from typing import Any

import numpy as np
import xxhash

from terraport.access import Access
from terraport.base import BaseMesh
from terraport.caller_line import CallerLine
from terraport.coarser import CoarserPiece
from terraport.disk_cache import DiskCache
from terraport.disk_worker import DiskWorker
from terraport.errors import (
    GroupError,
    OutsideSceneWarning,
    ServerError,
    SessionClosedError,
    TerraportError,
)
from terraport.events import FetchNeeded, FetchStopped, Opened
from terraport.group import Group, GroupRecord
from terraport.http import SceneHttp
from terraport.intake import EventIntake
from terraport.landing import Landing
from terraport.link import Link
from terraport.payloads import scales_of
from terraport.places import Place
from terraport.puller import Puller
from terraport.scene_box import SceneBox
from terraport.session import ClientSession
from terraport.session_stats import SessionStats
from terraport.timeouts import Timeouts
from terraport.urls import SceneUrl
from terraport_wire import Hit, SceneInfo, ServerLimits

__all__ = ["Session"]


class Session:
    """One scene, open, over as many connections as it takes. Made by :func:`connect`.

    It owns the link, the disk worker and their tasks, and ends them in :meth:`aclose`; a landing or
    group that it handed out ends with it.
    """

    def __init__(
        self,
        state: ClientSession,
        http: SceneHttp,
        url: SceneUrl,
        access: Access,
        timeouts: Timeouts,
        disk: DiskCache | None,
        group: str | None = None,
    ) -> None:
        self._state = state
        self._http = http
        self._url = url
        self._timeouts = timeouts
        self._disk = disk
        # Events need the link to answer, and the link needs somebody to give events to.
        self._intake = intake = EventIntake(state, pump=self._pump, on_opened=self._on_opened)
        self._link = Link(
            state, url.stream, access, timeouts, intake.take, prepare=self._read_scales
        )
        self._scales_version: str | None = None
        self._link.group = group
        if disk is not None:
            intake.worker = DiskWorker(
                disk,
                restored=intake.restored,
                lost=intake.lost,
                stored=intake.stored,
                removed=intake.removed,
                in_memory=state.holdings.peek,
            )
        self._worker = intake.worker
        self._puller: Puller | None = None
        if state.options.pull:
            intake.on_fetch = self._on_fetch
            self._puller = Puller(
                access,
                timeouts.http_s,
                arrived=self._on_fetched,
                told=self._on_range_ended,
                lost=self._on_unreached,
            )
        self._welcome: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.unreached_pack: str | None = None
        """Why payload is not fetched any more but comes in frames; None where nothing failed."""
        self._failure: TerraportError | None = None
        self._base: BaseMesh | None = None
        self._base_lock = asyncio.Lock()
        # The link's first, then the disk worker's; `aclose` ends them all.
        self._tasks: list[asyncio.Task[None]] = []

    # ---- what is served

    def __repr__(self) -> str:
        """Say which scene it is a session of; never the token."""
        return f"<Session {self.url}>"

    @property
    def scene(self) -> SceneInfo:
        """Id, version, name and number of segments, as of the newest connection."""
        return self._welcomed.scene

    @property
    def limits(self) -> ServerLimits:
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
        return self._state.visible

    @property
    def newest_version(self) -> str | None:
        """A newer scene version that the server has announced; served from the next connection."""
        return self._intake.newest_version

    @property
    def stats(self) -> SessionStats:
        """What has been transferred, and how well aims foresaw it, over all connections."""
        aims = self._state.aims
        return SessionStats(
            connections=self._link.connections,
            received_bytes=self._link.received_bytes,
            payload_bytes=self._intake.payload_bytes,
            prefetched_bytes=aims.prefetched_bytes,
            prefetch_used_bytes=aims.used_bytes,
            aimed_landings=aims.landings,
            aim_hits=aims.hits,
            repeated_bytes=self._state.repeated_bytes,
            rejected=self._intake.rejected,
            cache_bytes=self._state.holdings.cache_bytes,
            pulled_bytes=0 if self._puller is None else self._puller.received_bytes,
            pull_requests=0 if self._puller is None else self._puller.requests,
        )

    async def manifest(self) -> dict[str, Any]:
        """Return the manifest of the served version (``spec/scene-format.md``, section 4).

        Raises
        ------
        HttpError
            The server does not answer.
        """
        return await self._http.manifest(self.scene.version)

    async def base(self) -> BaseMesh:
        """Return the base mesh with its cover, loaded once per scene version.

        May be called from several tasks: one loads, the others wait for it.

        Raises
        ------
        HttpError
            The server does not answer.
        ProtocolViolationError
            What came is not what the manifest promises.
        """
        async with self._base_lock:
            # A reconnect may lead to another version while the files come: then once more (2.5).
            while self._base is None or self._base.version != self.scene.version:
                self._base = await self._http.base(self.scene.version, self._disk)
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
            The server refuses this landing; an older one that is not ready goes on.
        LandingSupersededError
            Another task has landed meanwhile.
        LandingTimeoutError
            No plan in time.
        SessionClosedError
            The session has ended.
        """
        return self._land(
            CallerLine.find(),
            position,
            radius_m,
            coarse_radius_m=coarse_radius_m,
            inner_radius_m=inner_radius_m,
            deadline_s=deadline_s,
            stall_s=stall_s,
            timeout_s=timeout_s,
        )

    async def _land(
        self,
        caller: CallerLine,
        position: Sequence[float],
        radius_m: float,
        *,
        coarse_radius_m: float | None,
        inner_radius_m: float | None,
        deadline_s: float | None,
        stall_s: float | None,
        timeout_s: float | None,
    ) -> Landing:
        self._require_open()
        number = self._state.land(
            position,
            radius_m,
            inner_radius_m=inner_radius_m,
            deadline_ms=_milliseconds(deadline_s),
            stall_ms=_milliseconds(stall_s),
            coarse_radius_m=coarse_radius_m,
        )
        # Nothing is sent before `pump`: the record is there when the first event of it comes.
        record = self._intake.waiting.begin_landing(number)
        self._link.pump()
        landing = Landing(record)
        plan = await landing.planned(self._timeouts.plan_s if timeout_s is None else timeout_s)
        # Whatever loads or keeps something is in the scene: only empty plans are looked at.
        if not (len(plan.load) or len(plan.keep) or plan.omitted_segments):
            record.outside_m = await self._warn_outside(plan.position, plan.radius_m, caller)
        return landing

    def aim(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        coarse_radius_m: float | None = None,
    ) -> None:
        """Tell where the user points, so that a landing there finds its segments held.

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
        self._state.aim(position, radius_m, coarse_radius_m)
        self._link.pump()

    async def pick(
        self,
        origin: Sequence[float],
        direction: Sequence[float] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Hit | None:
        """Ask what full detail has along a ray, whether its segments are loaded or not.

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
        request = self._state.pick(origin, direction)
        answer = self._intake.waiting.begin_pick(request)
        self._link.pump()
        try:
            async with asyncio.timeout(self._timeouts.pick_s if timeout_s is None else timeout_s):
                return await answer
        finally:
            self._intake.waiting.end_pick(request)
            self._state.drop_pick(request)

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
        # By query the URL must name this group; elsewhere it must only not name another (16.6).
        allowed = {group} if groups_served == "query" else {None, group}
        reroute = url_group not in allowed
        request = self._state.group.join(group, role, name)
        if self._intake.group is not None:
            self._intake.group.end(GroupError(f"group {self._intake.group.name} was left"))
        record = GroupRecord(
            group, self._state.group, land=self.land, pump=self._link.pump, request=request
        )
        # Before anything is sent: the answer is taken by whoever has the seat.
        self._intake.group = record
        if reroute:
            self._link.reroute(group)
        self._link.pump()
        await record.until(lambda: record.member > 0, timeout_s)
        return Group(record)

    async def visible_set_hash(self) -> str:
        """Return what identifies the picture of the last ready landing: 16 hexadecimal digits.

        It covers the ids of the visible segments and the hidden faces of the base mesh (which it
        loads if need be): a function of the last landing's plan, whatever happened since.
        """
        base = await self.base()
        # After the wait: the set that is visible now, not the one before the base was loaded.
        visible = self.visible
        digest = xxhash.xxh3_64(np.array(visible, dtype="<u4").tobytes())
        digest.update(np.packbits(base.hidden_faces(visible)).tobytes())
        return digest.hexdigest()

    async def aclose(self) -> None:
        """Say goodbye and free everything; may be called again. ``async with`` calls it."""
        if self._puller is not None:
            self._puller.stop()
        self._link.leave()
        try:
            async with asyncio.timeout(self._timeouts.close_s):
                # What came is paid for: it is written before the disk is left.
                if self._worker is not None and len(self._tasks) > 1:
                    await self._worker.drained()
                if self._tasks and self._state.open:  # else there is nobody to say goodbye to
                    await asyncio.wait(self._tasks[:1])
        except TimeoutError:
            pass  # what is left is cut off
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            self._fail(SessionClosedError("it was closed here"))
            if self._puller is not None:
                await self._puller.aclose()
            await self._http.aclose()

    # ---- private

    def _on_fetch(self, event: FetchNeeded | FetchStopped) -> None:
        assert self._puller is not None
        if isinstance(event, FetchNeeded):
            self._puller.want(event.address, event.fetches)
        else:
            self._puller.stop()

    def _on_fetched(self, segment: int, payload: bytes) -> None:
        self._state.fetched(segment, payload)
        self._link.pump()

    def _on_range_ended(self) -> None:
        self._state.tell_fetched()
        self._link.pump()

    def _on_unreached(self, reason: str) -> None:
        """Go on in frames: the connection is made anew, and what is held is not sent again."""
        self.unreached_pack = reason
        self._state.stop_pulling()
        self._link.renew()

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
        """Connect; called once, by :func:`connect`."""
        self._spawn(self._link.run(), "terraport-link")
        if self._worker is not None:
            self._spawn(self._worker.run(), "terraport-disk")
        await self._welcome

    @property
    def _welcomed(self) -> Opened:
        assert self._intake.opened is not None  # connect() waits for it
        return self._intake.opened

    async def _read_scales(self) -> None:
        """Fetch what decoding needs, once per scene version; a failure shows in decoding alone."""
        version = self.scene.version
        if version == self._scales_version:
            return
        try:
            self._intake.scales = scales_of(await self._http.manifest(version))
            self._scales_version = version
        except TerraportError as error:
            self._intake.scales = error

    def _pump(self) -> None:
        self._link.pump()

    def _on_opened(self) -> None:
        if not self._welcome.done():  # only the first welcome is waited for
            self._welcome.set_result(None)

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
        self._intake.fail(error)

    def _require_open(self) -> None:
        if self._failure is not None:
            raise SessionClosedError(str(self._failure)) from self._failure


def _milliseconds(seconds: float | None) -> int | None:
    return None if seconds is None else max(1, round(seconds * 1000))
