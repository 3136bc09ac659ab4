"""One landing of a group as a member sees it, and the record behind it that the session fills.

Everything here runs on the session's event loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from terraport.errors import (
    GroupError,
    LandingSupersededError,
    ServerError,
    TerraportError,
    UsageError,
)
from terraport.events import (
    GroupCalled,
    GroupGathered,
    GroupJoined,
    GroupRefused,
    GroupRoster,
)
from terraport.group_state import GroupState
from terraport.landing import Landing
from terraport_wire import Gathering, Member

__all__ = ["Arrivals", "GroupEvent", "GroupLanding", "GroupRecord"]

GroupEvent = GroupJoined | GroupRefused | GroupRoster | GroupCalled | GroupGathered


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Who has arrived when a barrier opened; members by number."""

    ready: tuple[int, ...]
    degraded: tuple[int, ...]
    """Those that show their inner set alone."""
    missing: tuple[int, ...]
    """Those that declined, or said nothing in time."""

    @property
    def complete(self) -> bool:
        """Whether everybody is ready."""
        return not self.degraded and not self.missing


class _Lands(Protocol):
    """``Session.land``."""

    async def __call__(
        self,
        position: Sequence[float],
        radius_m: float,
        *,
        inner_radius_m: float | None,
        deadline_s: float | None,
        stall_s: float | None,
    ) -> Landing:
        """Land as ``Session.land`` does."""


@dataclass(slots=True)
class GroupRecord:
    """What is known of a group. Filled by the session, on its event loop; read by the group."""

    name: str
    state: GroupState
    land: _Lands
    pump: Callable[[], None]
    request: int
    member: int = 0
    """Own number; 0 before the server has given one."""
    role: str = ""
    members: tuple[Member, ...] = ()
    newest: GroupLanding | None = None
    called: int = 0
    """Group landings told so far."""
    refused: dict[int, ServerError] = field(default_factory=dict)
    error: TerraportError | None = None
    tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _waiters: list[asyncio.Future[None]] = field(default_factory=list)

    def take(self, event: GroupEvent) -> None:
        """Take one event of the state machine."""
        if isinstance(event, GroupJoined):
            self.member, self.role = event.member, event.role
        elif isinstance(event, GroupRefused):
            refusal = ServerError(event.code, event.message)
            if event.request == self.request:
                self.end(refusal)
            else:
                self.refused[event.request] = refusal
        elif isinstance(event, GroupRoster):
            self.members = event.members
        elif isinstance(event, GroupCalled):
            older, self.newest = self.newest, GroupLanding(self, event.gathering)
            self.called += 1
            if older is not None:
                older.overtaken = True
        elif self.newest is not None and self.newest.number == event.gathering:
            self.newest.arrivals = Arrivals(event.ready, event.degraded, event.missing)
        self.changed()

    def end(self, error: TerraportError) -> None:
        """Note that nothing more will happen."""
        if self.error is None:
            self.error = error
        for task in self.tasks:
            task.cancel()
        self.changed()

    def changed(self) -> None:
        """Wake everyone who waits."""
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def until(self, reached: Callable[[], bool], timeout_s: float | None) -> None:
        """Wait for something; raise what has ended the group, or TimeoutError."""
        if timeout_s is not None and not timeout_s >= 0:
            raise UsageError(f"timeout_s is {timeout_s}, expected 0 or more, or None")
        async with asyncio.timeout(timeout_s):
            while not reached():
                if self.error is not None:
                    raise self.error
                waiter = asyncio.get_running_loop().create_future()
                self._waiters.append(waiter)
                await waiter

    async def until_called_or_over(self, seen: int) -> None:
        """Wait until more group landings were told than that, or nothing more will happen."""
        await self.until(lambda: self.called > seen or self.error is not None, None)


class GroupLanding:
    """One landing of the whole group, as this member is told of it.

    Nobody moves by itself: :meth:`land` does, or any landing of the caller's own followed by
    :meth:`arrived`; and who will not come says :meth:`decline`, so that the others need not wait.
    """

    def __init__(self, record: GroupRecord, gathering: Gathering) -> None:
        self._record = record
        self._gathering = gathering
        self.overtaken = False
        """Whether the guide has landed the group elsewhere since."""
        self.arrivals: Arrivals | None = None
        """Who has arrived; None while the barrier is shut."""

    @property
    def number(self) -> int:
        """Rises from landing to landing of the group."""
        return self._gathering.gathering

    @property
    def guide(self) -> int:
        """Number of the member who asked for it."""
        return self._gathering.guide

    @property
    def position(self) -> tuple[float, float, float]:
        """Metres, scene frame."""
        return self._gathering.position

    @property
    def radius_m(self) -> float:
        """What the guide asks everybody to load."""
        return self._gathering.radius_m

    @property
    def inner_radius_m(self) -> float | None:
        """Radius of the set that may be shown when time is short."""
        return self._gathering.inner_radius_m

    @property
    def left_s(self) -> float | None:
        """Seconds that the others wait at most, as of when this came; None: nobody waits."""
        left_ms = self._gathering.left_ms
        return None if left_ms is None else left_ms / 1000.0

    async def land(
        self,
        position: Sequence[float] | None = None,
        radius_m: float | None = None,
        *,
        stall_s: float | None = None,
    ) -> Landing:
        """Land with the group, and say so to it as soon as it is ready.

        Parameters
        ----------
        position : sequence of 3 floats, optional
            Where to stand; the group's place without it. Members that spread around it stand
            apart.
        radius_m : float, optional
            The group's without it.
        stall_s : float, optional
            As for :meth:`terraport.Session.land`; the group's own deadline counts as well, where it
            names an inner radius.

        Returns
        -------
        Landing
            Its plan is here, its segments are coming. It tells the group ``ready`` or
            ``degraded`` by itself, and ``declined`` where it fails.

        Raises
        ------
        TerraportError
            What :meth:`terraport.Session.land` raises; the group is told that this member does not
            come.
        """
        inner = self.inner_radius_m
        radius = self.radius_m if radius_m is None else radius_m
        if inner is not None:
            inner = min(inner, radius)
        try:
            landing = await self._record.land(
                self.position if position is None else position,
                radius,
                inner_radius_m=inner,
                deadline_s=None if inner is None or not self.left_s else self.left_s,
                stall_s=None if inner is None else stall_s,
            )
        except TerraportError:
            self.decline()
            raise
        task = asyncio.create_task(self._report(landing), name="terraport-arrival")
        self._record.tasks.add(task)
        task.add_done_callback(self._record.tasks.discard)
        return landing

    def arrived(self, *, degraded: bool = False) -> None:
        """Say that this member is there: with its whole landing, or its inner set alone."""
        self._say("degraded" if degraded else "ready")

    def decline(self) -> None:
        """Say that this member does not come."""
        self._say("declined")

    async def all_there(self, timeout_s: float | None = None) -> Arrivals:
        """Wait for the barrier: everybody is ready, or the deadline has passed.

        Raises
        ------
        GroupError
            The guide has landed the group elsewhere, or the group was left.
        ServerError
            The seat could not be had again after a reconnect.
        TimeoutError
            `timeout_s` ran out.
        SessionClosedError
            The session has ended.
        """
        await self._record.until(lambda: self.arrivals is not None or self.overtaken, timeout_s)
        if self.arrivals is None:
            raise GroupError(f"group landing {self.number} was overtaken by a newer one")
        return self.arrivals

    async def _report(self, landing: Landing) -> None:
        try:
            await landing.presentable()
            if not landing.is_ready:
                self.arrived(degraded=True)
            await landing.ready(allow_missing=True)
            self.arrived()
        except LandingSupersededError:
            if not self.overtaken:
                self.decline()  # its user went elsewhere
        except TerraportError:
            self.decline()

    def _say(self, state: str) -> None:
        self._record.state.arrived(self.number, state)
        self._record.pump()

    def __repr__(self) -> str:
        x, y, z = self.position
        return f"<GroupLanding {self.number} at ({x:g}, {y:g}, {z:g}), {self.radius_m:g} m>"
