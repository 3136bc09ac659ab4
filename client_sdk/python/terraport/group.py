"""Groups: members, and landings that their guide starts.

Made by :meth:`terraport.Session.join_group`. Everything here runs on the session's event loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from terraport.errors import GroupError, LandingSupersededError, ServerError, TerraportError
from terraport.events import GroupEvent, GroupRefused
from terraport.landing import Changes, Landing
from terraport.seat import Seat
from terraport_wire import Gathering, Joined, Member, Roster

__all__ = [
    "Arrivals",
    "Group",
    "GroupFacts",
    "GroupLanding",
    "GroupLandingFacts",
    "GroupRecord",
]


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Members that had arrived when a barrier opened, by number."""

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
    seat: Seat
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
    changes: Changes = field(default_factory=Changes)

    def take(self, event: GroupEvent) -> None:
        """Take one event of the state machine."""
        if isinstance(event, Joined):
            self.member, self.role = event.member, event.role
        elif isinstance(event, GroupRefused):
            refusal = ServerError(event.code, event.message)
            if event.request == self.request:
                self.end(refusal)
            else:
                self.refused[event.request] = refusal
        elif isinstance(event, Roster):
            self.members = event.members
        elif isinstance(event, Gathering):
            if self.newest is not None:
                self.newest.overtaken = True
            self.newest = GroupLanding(self, event)
            self.called += 1
        elif self.newest is not None and self.newest.number == event.gathering:
            sides = (event.ready, event.degraded, event.missing)
            self.newest.arrivals = Arrivals(*(tuple(side.tolist()) for side in sides))
        self.changes.changed()

    def end(self, error: TerraportError) -> None:
        """Note that nothing more will happen."""
        if self.error is None:
            self.error = error
        for task in self.tasks:
            task.cancel()
        self.changes.changed()

    async def until(self, is_reached: Callable[[], bool], timeout_s: float | None) -> None:
        """Wait for something; raise what has ended the group, or TimeoutError."""
        await self.changes.until(is_reached, lambda: self.error, timeout_s)


class GroupLandingFacts:
    """What is known of a group landing now."""

    def __init__(self, record: GroupRecord, gathering: Gathering) -> None:
        self.record = record
        self.gathering = gathering

    @property
    def number(self) -> int:
        """Rises from landing to landing of the group."""
        return self.gathering.gathering

    @property
    def guide(self) -> int:
        """Number of the member who asked for it."""
        return self.gathering.guide

    @property
    def position(self) -> tuple[float, float, float]:
        """Metres, scene frame."""
        return self.gathering.position

    @property
    def radius_m(self) -> float:
        """What the guide asks everybody to load."""
        return self.gathering.radius_m

    @property
    def inner_radius_m(self) -> float | None:
        """Radius of the set that may be shown when time is short."""
        return self.gathering.inner_radius_m

    @property
    def left_s(self) -> float | None:
        """Seconds that the others wait at most, as of when this came; None: nobody waits."""
        left_ms = self.gathering.left_ms
        return None if left_ms is None else left_ms / 1000.0

    def __repr__(self) -> str:
        x, y, z = self.position
        return f"<GroupLanding {self.number} at ({x:g}, {y:g}, {z:g}), {self.radius_m:g} m>"


class GroupLanding(GroupLandingFacts):
    """One landing of the whole group.

    It does not move this member: call :meth:`land`, or land in another way and then call
    :meth:`arrived`. Call :meth:`decline` to stay away, so that the others need not wait.
    """

    def __init__(self, record: GroupRecord, gathering: Gathering) -> None:
        super().__init__(record, gathering)
        self.overtaken = False
        """Whether the guide has landed the group elsewhere since."""
        self.arrivals: Arrivals | None = None
        """Who has arrived; None while the barrier is shut."""

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
            landing = await self.record.land(
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
        self.record.tasks.add(task)
        task.add_done_callback(self.record.tasks.discard)
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
        await self.record.until(lambda: self.arrivals is not None or self.overtaken, timeout_s)
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
        self.record.seat.arrived(self.number, state)
        self.record.pump()


class GroupFacts:
    """What is known of a group now."""

    def __init__(self, record: GroupRecord) -> None:
        self.record = record

    @property
    def name(self) -> str:
        """Name that the members joined by."""
        return self.record.name

    @property
    def member(self) -> int:
        """Own number in the group."""
        return self.record.member

    @property
    def role(self) -> str:
        """``"guide"`` or ``"member"``."""
        return self.record.role

    @property
    def members(self) -> tuple[Member, ...]:
        """Everybody in the group, ascending number; ``present`` is False where one is lost.

        ``position`` is the centre of a member's last landing in metres of the scene frame, None
        before its first; it follows within about a second.
        """
        return self.record.members

    def __repr__(self) -> str:
        return f"<Group {self.name}: {self.role} {self.member} of {len(self.members)}>"


class Group(GroupFacts):
    """A seat in a group. A lost connection gives it back for as long as the server keeps it.

    ::

        group = await session.join_group("tour")
        async for call in group:  # the newest; older ones are skipped
            landing = await call.land()
            arrivals = await call.all_there()
    """

    @property
    def newest(self) -> GroupLanding | None:
        """The group landing that was called last; None before the first."""
        return self.record.newest

    async def members_present(self, count: int, timeout_s: float | None = None) -> None:
        """Wait until so many members are present, this one included.

        Raises what :meth:`GroupLanding.all_there` raises.
        """
        await self.record.until(
            lambda: sum(member.present for member in self.members) >= count, timeout_s
        )

    async def land_group(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        inner_radius_m: float | None = None,
        deadline_s: float | None = None,
        timeout_s: float | None = 30.0,
    ) -> GroupLanding:
        """Land everybody, as the guide; return when the server has passed it on.

        The guide is told like everybody else: it lands by :meth:`GroupLanding.land`.

        Parameters
        ----------
        position : sequence of 3 floats
            Metres, scene frame.
        radius_m : float
            Asked of everybody; each member's own budgets bound what it loads.
        inner_radius_m : float, optional
            What members may show when time is short.
        deadline_s : float, optional
            When the barrier opens without who is missing; the server's without it, which also
            bounds it.
        timeout_s : float or None
            Bound on the wait for the server's word.

        Raises
        ------
        UsageError
            A number that the protocol does not allow.
        ServerError
            ``group_refused``: this member is not the guide, or the radius is too large.
        TimeoutError
            No word in time.
        """
        record = self.record
        if record.error is not None:
            raise record.error
        before = record.called
        request = record.seat.gather(
            position,
            radius_m,
            inner_radius_m=inner_radius_m,
            deadline_ms=None if deadline_s is None else max(1, round(deadline_s * 1000)),
        )
        record.pump()
        await record.until(lambda: record.called > before or request in record.refused, timeout_s)
        refusal = record.refused.pop(request, None)
        if refusal is not None:
            raise refusal
        assert record.newest is not None
        return record.newest

    async def next_landing(self, timeout_s: float | None = None) -> GroupLanding:
        """Wait for the next group landing that has not been told when this is called.

        Raises what :meth:`GroupLanding.all_there` raises.
        """
        record, before = self.record, self.record.called
        await record.until(lambda: record.called > before, timeout_s)
        assert record.newest is not None
        return record.newest

    async def leave(self) -> None:
        """Give up the seat. Barriers no longer count this member."""
        self.record.seat.leave()
        self.record.end(GroupError(f"group {self.name} was left"))
        self.record.pump()

    def __aiter__(self) -> AsyncIterator[GroupLanding]:
        """Iterate over group landings: the newest that was not seen yet, if there is one, and on.

        Ends when the group is left; raises what ended it otherwise.
        """
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[GroupLanding]:
        record, seen = self.record, 0
        while True:
            while record.called == seen and record.error is None:
                await record.changes.change()
            if isinstance(record.error, GroupError):
                return
            if record.error is not None:
                raise record.error
            seen = record.called
            assert record.newest is not None
            yield record.newest
