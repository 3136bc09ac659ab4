"""The same sessions without asyncio.

::

    with terraport.sync.connect("http://localhost:8080/scenes/quarry", token) as session:
        landing = session.land((12.0, 3.5, -40.0), radius_m=60)
        for segment in landing:
            mesh = segment.arrays()

**Contracts.** Each session has a thread of its own with an event loop in it; it ends with the
``with`` block. Calls block the calling thread, may come from several threads at once, and may be
interrupted by Ctrl-C at any time: the interrupted call ends, the session lives on until its
``with`` block is left. Segments, meshes and base are the very same classes as in :mod:`terraport`.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
from collections.abc import Coroutine, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Self, TypeVar

from terraport import client
from terraport.access import Token
from terraport.base import BaseMesh
from terraport.coarser import CoarserPiece
from terraport.disk_cache import DEFAULT_DISK_BYTES
from terraport.errors import SessionClosedError
from terraport.places import Place
from terraport.sync_group import Group, GroupLanding
from terraport.sync_landing import Landing
from terraport.timeouts import Timeouts
from terraport_wire import Hit, SceneInfo, ServerLimits

__all__ = ["Group", "GroupLanding", "Landing", "Session", "connect"]

_T = TypeVar("_T")

_POLL_S: Final = 0.2
"""Longest that Ctrl-C goes unnoticed where a thread's wait cannot be interrupted (Windows)."""


class Session:
    """A :class:`terraport.Session` whose methods block; a context manager.

    Its methods and properties mean, return and raise what those of the asynchronous one do.
    """

    def __init__(self, connecting: client.Connecting) -> None:
        self._connecting = connecting
        self._session: client.Session | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="terraport-sync", daemon=True)
        self._thread.start()
        try:
            self._session = self._wait(self._connecting.__aenter__())
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the session and its thread; may be called again."""
        if self._session is None or self._loop is None or self._loop.is_closed():
            return
        try:
            self._wait(self._session.aclose())
        finally:
            self._stop()

    def __repr__(self) -> str:
        """Say which scene it is a session of; never the token."""
        return "<Session, not open yet>" if self._session is None else repr(self._session)

    @property
    def scene(self) -> SceneInfo:
        """Id, version, name and number of segments."""
        return self._open.scene

    @property
    def limits(self) -> ServerLimits:
        """What the server allows."""
        return self._open.limits

    @property
    def url(self) -> str:
        """Address of the scene over HTTP."""
        return self._open.url

    @property
    def visible(self) -> tuple[int, ...]:
        """Ids of the segments that the last ready landing shows, ascending."""
        return self._open.visible

    @property
    def stats(self) -> client.SessionStats:
        """Counts so far."""
        return self._open.stats

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
    ) -> Landing:
        """Land, and return when the plan is there; see :meth:`terraport.Session.land`."""
        landing = self._wait(
            self._open.land(
                position,
                radius_m,
                coarse_radius_m=coarse_radius_m,
                inner_radius_m=inner_radius_m,
                deadline_s=deadline_s,
                stall_s=stall_s,
                timeout_s=timeout_s,
            )
        )
        return Landing(landing, self._wait)

    def aim(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        coarse_radius_m: float | None = None,
    ) -> None:
        """Tell where the user points; see :meth:`terraport.Session.aim`."""
        session = self._open

        async def aim() -> None:
            session.aim(position, radius_m, coarse_radius_m=coarse_radius_m)

        self._wait(aim())

    def pick(
        self,
        origin: Sequence[float],
        direction: Sequence[float] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Hit | None:
        """Ask what lies along a ray; see :meth:`terraport.Session.pick`."""
        return self._wait(self._open.pick(origin, direction, timeout_s=timeout_s))

    def join_group(
        self,
        group: str,
        *,
        role: str = "member",
        name: str | None = None,
        timeout_s: float | None = 30.0,
    ) -> Group:
        """Take a seat in a group; see :meth:`terraport.Session.join_group`."""
        joined = self._wait(self._open.join_group(group, role=role, name=name, timeout_s=timeout_s))
        return Group(joined, self._wait)

    def base(self) -> BaseMesh:
        """Return the base mesh with its cover; see :meth:`terraport.Session.base`."""
        return self._wait(self._open.base())

    def manifest(self) -> dict[str, Any]:
        """Return the manifest; see :meth:`terraport.Session.manifest`."""
        return self._wait(self._open.manifest())

    def places(self) -> tuple[Place, ...]:
        """Return the named regions; see :meth:`terraport.Session.places`."""
        return self._wait(self._open.places())

    def coarser(self, region: int) -> tuple[CoarserPiece, ...]:
        """Return what a region is part of; see :meth:`terraport.Session.coarser`."""
        return self._wait(self._open.coarser(region))

    def visible_set_hash(self) -> str:
        """Return what identifies the picture; see :meth:`terraport.Session.visible_set_hash`."""
        return self._wait(self._open.visible_set_hash())

    @property
    def _open(self) -> client.Session:
        if self._session is None:
            raise SessionClosedError("it was not entered: with terraport.sync.connect(...)")
        return self._session

    def _run(self) -> None:
        loop = self._loop
        assert loop is not None
        try:
            loop.run_forever()
            loop.run_until_complete(loop.shutdown_asyncgens())
            loop.run_until_complete(loop.shutdown_default_executor())
        finally:
            loop.close()

    def _stop(self) -> None:
        loop, thread = self._loop, self._thread
        if loop is not None and thread is not None and not loop.is_closed():
            loop.call_soon_threadsafe(loop.stop)
            thread.join()

    def _wait(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine on the session's loop; an interrupted wait cancels it."""
        loop = self._loop
        if loop is None or loop.is_closed():
            work.close()
            raise SessionClosedError("it was closed here")
        future = asyncio.run_coroutine_threadsafe(work, loop)
        try:
            while True:
                try:
                    return future.result(_POLL_S)
                except concurrent.futures.TimeoutError:
                    if future.done():
                        raise  # the coroutine's own timeout
        except BaseException:
            future.cancel()
            raise


def connect(
    url: str,
    token: Token = None,
    *,
    max_triangles: int | None = None,
    max_bytes: int | None = None,
    max_segments: int | None = None,
    max_gpu_mebibytes: int | None = None,
    cache_bytes: int = client.DEFAULT_CACHE_BYTES,
    cache_dir: str | Path | None = None,
    disk_bytes: int = DEFAULT_DISK_BYTES,
    credit_bytes: int = 16 << 20,
    release_factor: float | None = None,
    timeouts: Timeouts | None = None,
    group: str | None = None,
    delivery: Literal["push", "pull"] = "push",
) -> Session:
    """Connect to a scene: ``with connect(...) as session``.

    Takes what :func:`terraport.connect` takes, and raises what it raises; nothing happens before
    the ``with`` block is entered.
    """
    return Session(
        client.connect(
            url,
            token,
            max_triangles=max_triangles,
            max_bytes=max_bytes,
            max_segments=max_segments,
            max_gpu_mebibytes=max_gpu_mebibytes,
            cache_bytes=cache_bytes,
            cache_dir=cache_dir,
            disk_bytes=disk_bytes,
            credit_bytes=credit_bytes,
            release_factor=release_factor,
            timeouts=timeouts,
            group=group,
            delivery=delivery,
        )
    )
