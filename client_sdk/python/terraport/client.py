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
from pathlib import Path
from types import TracebackType
from typing import Final, Literal

from terraport.access import Access, Token
from terraport.cache import SegmentCache
from terraport.disk_cache import DEFAULT_DISK_BYTES, DiskCache
from terraport.errors import UsageError
from terraport.http import SceneHttp
from terraport.live import Session
from terraport.options import SessionOptions, checked
from terraport.session import ClientSession
from terraport.session_stats import SessionStats
from terraport.timeouts import Timeouts
from terraport.urls import SceneUrl
from terraport.version import __version__
from terraport_wire import Join

__all__ = ["DEFAULT_CACHE_BYTES", "Connecting", "Session", "SessionStats", "connect"]

DEFAULT_CACHE_BYTES: Final = 512 << 20
"""Room for several landings of 60 m at full detail."""


class Connecting:
    """A connection about to be made: ``async with connect(...) as session``."""

    def __init__(
        self,
        url: SceneUrl,
        token: Token,
        options: SessionOptions,
        timeouts: Timeouts,
        cache_bytes: int,
        cache_dir: Path | None,
        disk_bytes: int,
        group: str | None,
    ) -> None:
        self._url = url
        self._access = Access(token)
        self._options = options
        self._timeouts = timeouts
        self._cache_bytes = cache_bytes
        self._cache_dir = cache_dir
        self._disk_bytes = disk_bytes
        self._group = group
        self._session: Session | None = None

    async def __aenter__(self) -> Session:
        http = SceneHttp(self._url, self._access, self._timeouts.http_s)
        try:
            url = await http.resolve()
            disk, on_disk = None, {}
            if self._cache_dir is not None:
                disk = await asyncio.to_thread(
                    DiskCache, self._cache_dir, url.key, self._disk_bytes
                )
                on_disk = await asyncio.to_thread(disk.catalogue)
            state = ClientSession(
                self._options, SegmentCache(self._cache_bytes), on_disk, server=url.server
            )
            session = Session(state, http, url, self._access, self._timeouts, disk, self._group)
        except BaseException:
            await http.aclose()
            raise
        try:
            await session.open()
        except BaseException:
            await session.aclose()
            raise
        self._session = session
        return session

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
    release_factor: float | None = None,
    timeouts: Timeouts | None = None,
    group: str | None = None,
    delivery: Literal["push", "pull"] = "push",
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
        Payload bytes kept in memory beside what is visible or on its way.
    cache_dir : Path, optional
        Keep segments and base meshes there too, from one run to the next. None: memory alone.
    disk_bytes : int
        Bound on everything in `cache_dir`.
    credit_bytes : int
        Payload bytes on their way at most.
    release_factor : float, optional
        What is held within radius x factor stays shown, 1 to 4; None takes the server's.
    timeouts : Timeouts, optional
        How long to wait for what.
    group : str, optional
        Group that the session will join: named in the address, by which a proxy may bring all of
        it to one server. :meth:`Session.join_group` joins it.
    delivery : {"push", "pull"}
        How payload comes: on the session's own connection; or fetched over HTTP, from where the
        server says, perhaps a CDN. A server that does not offer that sends it, and so does one
        whose packs cannot be reached.

    Returns
    -------
    Connecting
        An async context manager; nothing happens before it is entered. Entering raises

        * :class:`ConnectionFailedError`, :class:`HttpError` when nobody answers (a first connection
          is tried once; a lost one again and again, for ``timeouts.reconnect_s``),
        * :class:`ServerError` when the server refuses, with ``code`` such as ``"unauthorised"`` or
          ``"unknown_scene"``.

    Raises
    ------
    UsageError
        An argument that cannot work.
    """
    if delivery not in {"push", "pull"}:
        raise UsageError(f"delivery is {delivery!r}, expected 'push' or 'pull'")
    if group is not None:
        checked(lambda: Join(request=0, group=group, role="member"))
    options = SessionOptions(
        client=f"terraport-python {__version__}",
        max_triangles=max_triangles,
        max_bytes=cache_bytes if max_bytes is None else max_bytes,
        max_segments=max_segments,
        max_gpu_bytes=None if max_gpu_mebibytes is None else max_gpu_mebibytes << 20,
        credit_bytes=credit_bytes,
        release_factor=release_factor,
        pull=delivery == "pull",
    )
    return Connecting(
        SceneUrl.parse(url),
        token,
        options,
        timeouts or Timeouts(),
        cache_bytes,
        None if cache_dir is None else Path(cache_dir),
        disk_bytes,
        group,
    )
