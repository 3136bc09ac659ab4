"""Which worker process a group lives in.

All of a group must meet in one process. A worker that has members of a group stays its home for as
long as it has them, and lives; a name that nobody has yet goes to one of the serving workers by
rendezvous hashing: whoever asks gets the same answer, and when a worker goes, only its names move.

This method is from: D. G. Thaler and C. V. Ravishankar, "Using name-based mappings to increase hit
rates", IEEE/ACM Transactions on Networking 6(1), 1998.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, TypeVar

__all__ = ["GroupHomes"]

_Worker = TypeVar("_Worker", bound=Hashable)


class GroupHomes(Generic[_Worker]):
    """Homes of groups by name. Bounded: each worker tells of `max_groups` groups at most."""

    def __init__(self) -> None:
        self._names: dict[_Worker, frozenset[str]] = {}
        self._homes: dict[str, _Worker] = {}

    def tell(self, worker: _Worker, names: Iterable[str]) -> None:
        """Take what groups a worker has now; those that it had and has no more are homeless."""
        now, before = frozenset(names), self._names.get(worker, frozenset())
        for name in before - now:
            if self._homes.get(name) == worker:
                del self._homes[name]
        for name in now:
            self._homes.setdefault(name, worker)
        self._names[worker] = now

    def forget(self, worker: _Worker) -> None:
        """Let the groups of a worker that is gone, or takes nobody new, meet elsewhere."""
        self.tell(worker, ())
        del self._names[worker]

    def home_of(self, name: str, serving: Sequence[tuple[int, _Worker]]) -> _Worker | None:
        """Return the worker that a connection of this group goes to.

        Parameters
        ----------
        name
            Of the group.
        serving
            Slot and worker of each that takes new groups.

        Returns
        -------
        worker
            None where nobody serves.
        """
        home = self._homes.get(name)
        if home is not None or not serving:
            return home
        return max(serving, key=lambda one: _weight(name, one[0]))[1]


def _weight(name: str, slot: int) -> bytes:
    return hashlib.blake2b(f"{slot} {name}".encode(), digest_size=8).digest()
