"""What aims have brought, and what of it landings have used.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Collection

__all__ = ["AimCounts"]


class AimCounts:
    """Counts of one session, over all its connections."""

    __slots__ = ("_ahead", "_aimed", "hits", "landings", "prefetched_bytes", "used_bytes")

    def __init__(self) -> None:
        self.landings = 0
        """Landings that had an aim before them."""
        self.hits = 0
        """Those of them whose plan had nothing left to load."""
        self.prefetched_bytes = 0
        """Payload bytes of whole segments that came for aims."""
        self.used_bytes = 0
        """Those of them that the next landing kept."""
        self._ahead: dict[int, int] = {}
        self._aimed = False

    def prefetching(self) -> None:
        """Note that an aim is answered: the next landing is judged by it."""
        self._aimed = True

    def arrived(self, segment: int, length: int) -> None:
        """Note a whole segment that came for an aim."""
        self.prefetched_bytes += length
        self._ahead[segment] = length

    def planned(self, keep: Collection[int], *, loads: bool) -> None:
        """Judge what came ahead by the plan of the next landing.

        Parameters
        ----------
        keep : collection of int
            What of the plan was held.
        loads : bool
            Whether the plan has segments to load.
        """
        if self._aimed:
            self._aimed = False
            self.landings += 1
            self.hits += not loads
        ahead, self._ahead = self._ahead, {}
        self.used_bytes += sum(ahead.get(segment, 0) for segment in keep)
