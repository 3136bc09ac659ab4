"""The newest aim: noted, sent, and sent anew where a lost connection cut it short.

PURE: no I/O, no clock. Section numbers are those of ``spec/wire-protocol.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from terraport.landing_state import ring_of
from terraport.options import checked, point
from terraport_wire import Aim

__all__ = ["AimState"]


class AimState:
    """Where the user points. Older aims are forgotten; so are all once the user lands."""

    __slots__ = ("_generation", "_noted", "_sent")

    def __init__(self) -> None:
        self._noted: Aim | None = None
        self._sent: Aim | None = None
        self._generation = -1

    @property
    def waits(self) -> bool:
        """Whether an aim is to be sent."""
        return self._noted is not None

    def note(
        self, position: Sequence[float], radius_m: float, coarse_radius_m: float | None = None
    ) -> None:
        """Note the newest one, in place of any that waits.

        Raises
        ------
        UsageError
            A number that the protocol does not allow.
        """
        centre = point(position)
        self._noted = checked(
            lambda: Aim(
                generation=0, position=centre, radius_m=radius_m, coarse_radius_m=coarse_radius_m
            )
        )

    def take(self, generation: int, max_radius_m: float) -> Aim:
        """Return the message to send now, under a generation of this connection.

        Its server allows radii up to `max_radius_m`.
        """
        aim = self._noted
        assert aim is not None
        self._noted, self._sent, self._generation = None, aim, generation
        ring_m = ring_of(aim.radius_m, aim.coarse_radius_m, max_radius_m)
        return replace(aim, generation=generation, coarse_radius_m=ring_m)

    def clear(self) -> None:
        """Forget it: the user has landed."""
        self._noted = self._sent = None

    def refused(self, generation: int | None) -> None:
        """Forget it where it was refused: it would be again."""
        if generation is not None and generation == self._generation:
            self._sent = None

    def connection_lost(self, done: int) -> None:
        """Send it anew on the next connection, unless all of it had come (7, rule 4).

        Parameters
        ----------
        done : int
            Generation of the newest aim of which everything has come.
        """
        if self._noted is None and self._generation != done:
            self._noted = self._sent
        self._generation = -1
