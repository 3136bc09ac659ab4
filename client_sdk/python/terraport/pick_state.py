"""Picks that wait for an answer, over all connections of a session.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from terraport.events import Event, PickAnswered, PickRefused
from terraport.options import checked, point
from terraport_wire import Error, Message, Pick, Picked

__all__ = ["PickState"]


class PickState:
    """Asked again on the next connection until they are answered, refused or dropped.

    Parameters
    ----------
    report : callable
        Takes events.
    """

    __slots__ = ("_asked", "_report")

    def __init__(self, report: Callable[[Event], None]) -> None:
        self._report = report
        self._asked: dict[int, Pick] = {}

    def ask(
        self, request: int, origin: Sequence[float], direction: Sequence[float] | None
    ) -> Message:
        """Return the message that asks what lies along a ray.

        Raises
        ------
        UsageError
            A number that the protocol does not allow.
        """
        start = point(origin)
        along = None if direction is None else point(direction)
        pick = checked(lambda: Pick(request=request, origin=start, direction=along))
        self._asked[request] = pick
        return pick

    def waiting(self) -> list[Pick]:
        """Return those to ask again."""
        return list(self._asked.values())

    def drop(self, request: int) -> None:
        """Forget one: its answer is skipped."""
        self._asked.pop(request, None)

    def answered(self, picked: Picked) -> None:
        """Give an answer to the pick that asked for it."""
        if self._asked.pop(picked.request, None) is not None:
            self._report(PickAnswered(picked.request, picked.hit))

    def refused(self, error: Error) -> bool:
        """Take an error; return whether it was one of a pick's."""
        if error.request is None or self._asked.pop(error.request, None) is None:
            return False
        self._report(PickRefused(error.request, error.code, error.message))
        return True
