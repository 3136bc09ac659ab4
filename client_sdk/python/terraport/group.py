"""A group as its members see it: who is in it, and where its guide lands it.

Made by :meth:`terraport.Session.join_group`. Everything here runs on the session's event loop.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence

from terraport.errors import GroupError
from terraport.group_landing import Arrivals, GroupEvent, GroupLanding, GroupRecord
from terraport_wire import Member

__all__ = ["Arrivals", "Group", "GroupEvent", "GroupLanding", "GroupRecord"]


class Group:
    """A seat in a group. A lost connection gives it back for as long as the server keeps it.

    ::

        group = await session.join_group("tour")
        async for call in group:  # the newest; older ones are skipped
            landing = await call.land()
            arrivals = await call.all_there()
    """

    def __init__(self, record: GroupRecord) -> None:
        self._record = record

    @property
    def name(self) -> str:
        """Name that the members joined by."""
        return self._record.name

    @property
    def member(self) -> int:
        """Own number in the group."""
        return self._record.member

    @property
    def role(self) -> str:
        """``"guide"`` or ``"member"``."""
        return self._record.role

    @property
    def members(self) -> tuple[Member, ...]:
        """Everybody in the group, ascending number; ``present`` is False where one is lost.

        ``position`` is the centre of a member's last landing in metres of the scene frame, None
        before its first; it follows within about a second.
        """
        return self._record.members

    @property
    def newest(self) -> GroupLanding | None:
        """The group landing that was called last; None before the first."""
        return self._record.newest

    async def members_present(self, count: int, timeout_s: float | None = None) -> None:
        """Wait until so many members are present, this one included.

        Raises what :meth:`GroupLanding.all_there` raises.
        """
        await self._record.until(
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
        record = self._record
        if record.error is not None:
            raise record.error
        before = record.called
        request = record.state.gather(
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
        record, before = self._record, self._record.called
        await record.until(lambda: record.called > before, timeout_s)
        assert record.newest is not None
        return record.newest

    async def leave(self) -> None:
        """Give up the seat. Barriers no longer count this member."""
        self._record.state.leave()
        self._record.end(GroupError(f"group {self.name} was left"))
        self._record.pump()

    def __aiter__(self) -> AsyncIterator[GroupLanding]:
        """Iterate over group landings: the newest that was not seen yet, if there is one, and on.

        Ends when the group is left; raises what ended it otherwise.
        """
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[GroupLanding]:
        record, seen = self._record, 0
        while True:
            await record.until_called_or_over(seen)
            if isinstance(record.error, GroupError):
                return
            if record.error is not None:
                raise record.error
            seen = record.called
            assert record.newest is not None
            yield record.newest

    def __repr__(self) -> str:
        return f"<Group {self.name}: {self.role} {self.member} of {len(self.members)}>"
