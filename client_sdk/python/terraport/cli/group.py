"""``terraport land --group``: land together with others."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from terraport.errors import GroupError, UsageError

if TYPE_CHECKING:
    from terraport.group import Group, GroupLanding
    from terraport.landing import Landing
    from terraport.session import Session

__all__ = ["GroupOptions", "land_together", "place_of"]


@dataclass(frozen=True, slots=True)
class GroupOptions:
    """What the command line says of a group."""

    name: str
    guide: bool
    known_as: str | None
    members: int
    """Present members that a guide waits for."""


def place_of(
    given: tuple[float | None, float | None, float | None],
    together: GroupOptions | None,
    repeat: int,
) -> tuple[float, float, float] | None:
    """Return where to land; None where the group's guide says.

    Raises
    ------
    UsageError
        Arguments that do not go together.
    """
    x, y, z = given
    if together is not None and repeat != 1:
        raise UsageError("got --repeat with --group, expected one of them")
    if together is not None and not together.guide:
        if x is not None:
            raise UsageError("got X Y Z as a member of a group, expected none: the guide says")
        return None
    if x is None or y is None or z is None:
        got = " ".join(name for name, value in zip("XYZ", given, strict=True) if value is not None)
        raise UsageError(
            f"got {got or 'no X Y Z'}, expected x, y and z (or --group without --guide)"
        )
    return x, y, z


async def land_together(
    session: Session,
    options: GroupOptions,
    target: Callable[[], Awaitable[tuple[float, float, float]]],
    radius_m: float,
    watch: Callable[[Landing], Awaitable[None]],
    timeout_s: float,
) -> tuple[Landing, dict[str, Any]]:
    """Join, land with the others, and wait until all are there.

    Parameters
    ----------
    session : Session
        Open.
    options : GroupOptions
        Which group, and as what.
    target : callable
        Where the guide lands the group; members are told.
    radius_m : float
        Asked of everybody.
    watch : callable
        Waits for a landing, with a progress bar.
    timeout_s : float
        For the members to come, for the guide's word, and for the barrier each.

    Returns
    -------
    tuple
        The landing, and the group's facts for JSON and the table.
    """
    group = await session.join_group(
        options.name, role="guide" if options.guide else "member", name=options.known_as
    )
    try:
        call = await _call(group, options, target, radius_m, timeout_s)
        landing = await call.land()
        await watch(landing)
        arrivals = await call.all_there(timeout_s)
    except TimeoutError as error:
        raise GroupError(
            f"group {options.name} did not get together in {timeout_s:g} s: "
            f"{sum(member.present for member in group.members)} present"
        ) from error
    names = {member.member: member.name or f"member {member.member}" for member in group.members}
    facts = {
        "name": group.name,
        "member": group.member,
        "role": group.role,
        "position": list(call.position),
        "complete": arrivals.complete,
        **{
            state: [names.get(number, f"member {number}") for number in numbers]
            for state, numbers in asdict(arrivals).items()
        },
    }
    await group.leave()
    return landing, facts


async def _call(
    group: Group,
    options: GroupOptions,
    target: Callable[[], Awaitable[tuple[float, float, float]]],
    radius_m: float,
    timeout_s: float,
) -> GroupLanding:
    """Ask for the group landing, or wait for the guide's."""
    if not options.guide:
        return group.newest or await group.next_landing(timeout_s)
    await group.members_present(options.members, timeout_s)
    return await group.land_group(await target(), radius_m, deadline_s=timeout_s)
