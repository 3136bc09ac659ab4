"""The same sessions without asyncio.

::

    with terraport.sync.connect("http://localhost:8080/scenes/quarry", token) as session:
        landing = session.land((12.0, 3.5, -40.0), radius_m=60)
        for segment in landing:
            mesh = segment.arrays()

In a notebook ``session = terraport.sync.connect(...).open()``, and ``session.close()`` in the end.

**Contracts.** Each session has a thread of its own with an event loop in it; it ends with the
``with`` block or :meth:`Session.close`. Calls block the calling thread, may come from several
threads at once, and may be interrupted by Ctrl-C at any time: the interrupted call ends, the
session lives on. Segments, meshes and base are the very same classes as in :mod:`terraport`.
Methods take, return and raise what those of the same name there do.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import functools
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from types import TracebackType
from typing import Any, Concatenate, Final, Generic, ParamSpec, Self, TypeVar

from terraport import group as _group
from terraport import landing as _landing
from terraport import session as _session
from terraport.errors import SessionClosedError
from terraport.group import Arrivals, GroupFacts, GroupLandingFacts
from terraport.landing import LandingFacts
from terraport_payload.types import Bool
from terraport_wire import Limits, SceneFacts

__all__ = ["Group", "GroupLanding", "Landing", "Session", "connect"]

_T = TypeVar("_T")
_A = TypeVar("_A")
_P = ParamSpec("_P")

_POLL_S: Final = 0.2
"""Longest that Ctrl-C goes unnoticed where a thread's wait cannot be interrupted (Windows)."""


class _Loop:
    """An event loop in a thread."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="terraport-sync", daemon=True)
        self._thread.start()

    def wait(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine there; an interrupted wait cancels it."""
        if self._loop.is_closed():
            work.close()
            raise SessionClosedError("it was closed here")
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
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

    def each(self, items: AsyncIterator[_T]) -> Iterator[_T]:
        """Iterate over what comes there."""
        end = object()

        async def following() -> Any:
            return await anext(items, end)

        while (item := self.wait(following())) is not end:
            yield item

    def stop(self) -> None:
        """End loop and thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()

    def _run(self) -> None:
        try:
            self._loop.run_forever()
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
        finally:
            self._loop.close()


class _Blocking(Generic[_A]):
    """The blocking face of an object that lives on a loop."""

    def __init__(self, inner: _A, loop: _Loop) -> None:
        self._given = inner
        self._loop = loop

    @property
    def _inner(self) -> _A:
        return self._given


def _waits(
    method: Callable[Concatenate[_A, _P], Coroutine[Any, Any, _T]],
) -> Callable[Concatenate[_Blocking[_A], _P], _T]:
    """Return a method that waits for one of the same name."""

    @functools.wraps(method)
    def call(self: _Blocking[_A], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        inner = self._inner
        return self._loop.wait(method(inner, *args, **kwargs))

    return call


def _calls(
    method: Callable[Concatenate[_A, _P], _T],
) -> Callable[Concatenate[_Blocking[_A], _P], _T]:
    """Return a method that has one of the same name called on its loop."""

    @functools.wraps(method)
    def call(self: _Blocking[_A], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        inner = self._inner

        async def work() -> _T:
            return method(inner, *args, **kwargs)

        return self._loop.wait(work())

    return call


class Landing(_Blocking[_landing.Landing], LandingFacts):
    """A :class:`terraport.Landing` whose methods block."""

    def __init__(self, inner: _landing.Landing, loop: _Loop) -> None:
        _Blocking.__init__(self, inner, loop)
        LandingFacts.__init__(self, inner.record)

    ready = _waits(_landing.Landing.ready)
    presentable = _waits(_landing.Landing.presentable)

    def __iter__(self) -> Iterator[_landing.Segment]:
        """Iterate over the segments as they arrive."""
        return self._loop.each(aiter(self._inner))


def _landed(
    method: Callable[Concatenate[_A, _P], Coroutine[Any, Any, _landing.Landing]],
) -> Callable[Concatenate[_Blocking[_A], _P], Landing]:
    @functools.wraps(method)
    def call(self: _Blocking[_A], /, *args: _P.args, **kwargs: _P.kwargs) -> Landing:
        inner = self._inner
        return Landing(self._loop.wait(method(inner, *args, **kwargs)), self._loop)

    return call


class GroupLanding(_Blocking[_group.GroupLanding], GroupLandingFacts):
    """A :class:`terraport.GroupLanding` whose methods block."""

    def __init__(self, inner: _group.GroupLanding, loop: _Loop) -> None:
        _Blocking.__init__(self, inner, loop)
        GroupLandingFacts.__init__(self, inner.record, inner.gathering)

    @property
    def overtaken(self) -> bool:
        """Whether the guide has landed the group elsewhere since."""
        return self._inner.overtaken

    @property
    def arrivals(self) -> Arrivals | None:
        """Who has arrived; None while the barrier is shut."""
        return self._inner.arrivals

    land = _landed(_group.GroupLanding.land)
    arrived = _calls(_group.GroupLanding.arrived)
    decline = _calls(_group.GroupLanding.decline)
    all_there = _waits(_group.GroupLanding.all_there)


class Group(_Blocking[_group.Group], GroupFacts):
    """A :class:`terraport.Group` whose methods block."""

    def __init__(self, inner: _group.Group, loop: _Loop) -> None:
        _Blocking.__init__(self, inner, loop)
        GroupFacts.__init__(self, inner.record)

    members_present = _waits(_group.Group.members_present)
    leave = _waits(_group.Group.leave)

    @functools.wraps(_group.Group.land_group)
    def land_group(self, *args: Any, **kwargs: Any) -> GroupLanding:
        """Land everybody, as the guide."""
        return GroupLanding(self._loop.wait(self._inner.land_group(*args, **kwargs)), self._loop)

    def __iter__(self) -> Iterator[GroupLanding]:
        """Iterate over group landings."""
        for call in self._loop.each(aiter(self._inner)):
            yield GroupLanding(call, self._loop)


class Session(_Blocking[_session.Session]):
    """A :class:`terraport.Session` whose methods block; a context manager."""

    def __init__(self, connecting: _session.Connecting) -> None:
        self._connecting = connecting
        self._opened: _session.Session | None = None

    @property
    def _inner(self) -> _session.Session:
        if self._opened is None:
            raise SessionClosedError("it was not opened: with terraport.sync.connect(...)")
        return self._opened

    def open(self) -> Self:
        """Connect without ``with``; :meth:`close` ends it."""
        self._loop = _Loop()
        try:
            self._opened = self._loop.wait(self._connecting.open())
        except BaseException:
            self._loop.stop()
            raise
        return self

    def close(self) -> None:
        """Close the session and its thread; may be called again."""
        if self._opened is not None:
            try:
                self._loop.wait(self._opened.aclose())
            except SessionClosedError:
                return  # before
            finally:
                self._loop.stop()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        """Say which scene it is a session of; never the token."""
        return "<Session, not open yet>" if self._opened is None else repr(self._opened)

    @property
    def scene(self) -> SceneFacts:
        """Id, version, name, segments and base faces."""
        return self._inner.scene

    @property
    def limits(self) -> Limits:
        """What the server allows."""
        return self._inner.limits

    @property
    def url(self) -> str:
        """Address of the scene over HTTP."""
        return self._inner.url

    @property
    def visible(self) -> tuple[int, ...]:
        """Ids of the segments that the last ready landing shows, ascending."""
        return self._inner.visible

    @property
    def hidden_faces(self) -> Bool:
        """Base faces that are hidden while :attr:`visible` is shown, (B,) bool."""
        return self._inner.hidden_faces

    @property
    def newest_version(self) -> str | None:
        """A newer scene version that the server has announced."""
        return self._inner.newest_version

    @property
    def stats(self) -> _session.SessionStats:
        """Counts so far."""
        return self._inner.stats

    land = _landed(_session.Session.land)
    aim = _calls(_session.Session.aim)
    pick = _waits(_session.Session.pick)
    base = _waits(_session.Session.base)
    manifest = _waits(_session.Session.manifest)
    places = _waits(_session.Session.places)
    coarser = _waits(_session.Session.coarser)
    visible_set_hash = _waits(_session.Session.visible_set_hash)

    @functools.wraps(_session.Session.join_group)
    def join_group(self, *args: Any, **kwargs: Any) -> Group:
        """Take a seat in a group."""
        inner = self._inner
        return Group(self._loop.wait(inner.join_group(*args, **kwargs)), self._loop)


def _connects(make: Callable[_P, _session.Connecting]) -> Callable[_P, Session]:
    @functools.wraps(make)
    def connect(*args: _P.args, **kwargs: _P.kwargs) -> Session:
        return Session(make(*args, **kwargs))

    return connect


connect = _connects(_session.connect)
"""Connect to a scene: ``with connect(...) as session``; takes what :func:`terraport.connect` takes.

Nothing happens before the ``with`` block is entered, or :meth:`Session.open` called.
"""
