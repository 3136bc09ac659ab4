"""Groups without asyncio; see :mod:`terraport.sync`."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterator, Sequence
from typing import Any

from terraport import group as asynchronous
from terraport.group import Arrivals
from terraport.sync_landing import Landing
from terraport_wire import Member

__all__ = ["Group", "GroupLanding"]

_Wait = Callable[[Coroutine[Any, Any, Any]], Any]


class GroupLanding:
    """A :class:`terraport.GroupLanding` whose methods block."""

    def __init__(self, call: asynchronous.GroupLanding, wait: _Wait) -> None:
        self._call = call
        self._wait = wait

    @property
    def number(self) -> int:
        """Rises from landing to landing of the group."""
        return self._call.number

    @property
    def guide(self) -> int:
        """Number of the member who asked for it."""
        return self._call.guide

    @property
    def position(self) -> tuple[float, float, float]:
        """Metres, scene frame."""
        return self._call.position

    @property
    def radius_m(self) -> float:
        """What the guide asks everybody to load."""
        return self._call.radius_m

    @property
    def inner_radius_m(self) -> float | None:
        """Radius of the set that may be shown when time is short."""
        return self._call.inner_radius_m

    @property
    def left_s(self) -> float | None:
        """Seconds that the others wait at most; None: nobody waits."""
        return self._call.left_s

    @property
    def overtaken(self) -> bool:
        """Whether the guide has landed the group elsewhere since."""
        return self._call.overtaken

    @property
    def arrivals(self) -> Arrivals | None:
        """Who has arrived; None while the barrier is shut."""
        return self._call.arrivals

    def land(
        self,
        position: Sequence[float] | None = None,
        radius_m: float | None = None,
        *,
        stall_s: float | None = None,
    ) -> Landing:
        """Land with the group; see :meth:`terraport.GroupLanding.land`."""
        landing = self._wait(self._call.land(position, radius_m, stall_s=stall_s))
        return Landing(landing, self._wait)

    def arrived(self, *, degraded: bool = False) -> None:
        """Say that this member is there."""

        async def arrived() -> None:
            self._call.arrived(degraded=degraded)

        self._wait(arrived())

    def decline(self) -> None:
        """Say that this member does not come."""

        async def decline() -> None:
            self._call.decline()

        self._wait(decline())

    def all_there(self, timeout_s: float | None = None) -> Arrivals:
        """Wait for the barrier; see :meth:`terraport.GroupLanding.all_there`."""
        arrivals: Arrivals = self._wait(self._call.all_there(timeout_s))
        return arrivals

    def __repr__(self) -> str:
        return repr(self._call)


class Group:
    """A :class:`terraport.Group` whose methods block."""

    def __init__(self, group: asynchronous.Group, wait: _Wait) -> None:
        self._group = group
        self._wait = wait

    @property
    def name(self) -> str:
        """Name that the members joined by."""
        return self._group.name

    @property
    def member(self) -> int:
        """Own number in the group."""
        return self._group.member

    @property
    def role(self) -> str:
        """``"guide"`` or ``"member"``."""
        return self._group.role

    @property
    def members(self) -> tuple[Member, ...]:
        """Everybody in the group, ascending number."""
        return self._group.members

    def members_present(self, count: int, timeout_s: float | None = None) -> None:
        """Wait until so many members are present; see :meth:`terraport.Group.members_present`."""
        self._wait(self._group.members_present(count, timeout_s))

    def land_group(
        self,
        position: Sequence[float],
        radius_m: float = 60.0,
        *,
        inner_radius_m: float | None = None,
        deadline_s: float | None = None,
        timeout_s: float | None = 30.0,
    ) -> GroupLanding:
        """Land everybody, as the guide; see :meth:`terraport.Group.land_group`."""
        call = self._wait(
            self._group.land_group(
                position,
                radius_m,
                inner_radius_m=inner_radius_m,
                deadline_s=deadline_s,
                timeout_s=timeout_s,
            )
        )
        return GroupLanding(call, self._wait)

    def leave(self) -> None:
        """Give up the seat."""
        self._wait(self._group.leave())

    def __iter__(self) -> Iterator[GroupLanding]:
        """Iterate over group landings; see :class:`terraport.Group`."""
        calls = self._group.__aiter__()

        async def following() -> asynchronous.GroupLanding | None:
            return await anext(calls, None)

        while (call := self._wait(following())) is not None:
            yield GroupLanding(call, self._wait)

    def __repr__(self) -> str:
        return repr(self._group)
