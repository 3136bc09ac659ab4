"""Compact set of segment ids: memory grows with its size, not with the scene.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyArray, AnyInt, Bool, UInt32
from terraport_wire import ID_DTYPE

__all__ = ["IdSet", "ascending"]

_MOST_ADDED: Final = 1024
"""Maximum ids in the Python set (about 60 bytes each) before they are merged into the array."""

_NONE: Final = np.zeros(0, dtype=ID_DTYPE)


class IdSet:
    """Set of segment ids, 4 bytes each, for single insertions and bulk queries.

    A landing adds segments as they are sent, and the next plan queries all its candidates at once.
    Single ids are collected in a small Python set, which bulk operations merge into a sorted array.
    An array of booleans would take 1 MB per session in a scene of a million segments.

    Parameters
    ----------
    ids
        Initial ids, in any order; duplicates are ignored.

    Examples
    --------
    >>> held = IdSet([7, 3])
    >>> held.add(5)
    >>> 5 in held, len(held), held.array().tolist()
    (True, 3, [3, 5, 7])
    >>> held.contains(np.array([1, 3, 5])).tolist()
    [False, True, True]
    """

    __slots__ = ("_added", "_sorted")

    def __init__(self, ids: npt.ArrayLike | None = None) -> None:
        self._sorted: UInt32 = _NONE if ids is None else ascending(np.asarray(ids, dtype=ID_DTYPE))
        self._added: set[int] = set()
        """Ids not in the sorted array yet; disjoint from it."""

    @classmethod
    def of_sorted(cls, ids: UInt32) -> IdSet:
        """Return a set of ascending unique ids; not copied, so they must not change."""
        id_set = cls()
        id_set._sorted = ids
        return id_set

    def __len__(self) -> int:
        """Return the number of ids."""
        return len(self._sorted) + len(self._added)

    def __contains__(self, segment: int) -> bool:
        """Return whether an id is in the set."""
        return segment in self._added or self._is_sorted_in(segment)

    def contains(self, ids: AnyInt) -> Bool:
        """Return for each id whether it is in the set."""
        members = self.array()
        if len(members) == 0 or len(ids) == 0:
            return np.zeros(len(ids), dtype=np.bool_)
        asked = ids.astype(ID_DTYPE, copy=False)  # another dtype would copy all of `members`
        positions = np.searchsorted(members, asked)
        positions[positions == len(members)] = 0
        is_member: Bool = members[positions] == asked
        return is_member

    def array(self) -> UInt32:
        """Return all ids, ascending; the caller must not change the array."""
        if self._added:
            new = np.fromiter(self._added, dtype=ID_DTYPE, count=len(self._added))
            self._added.clear()
            new.sort()
            self._sorted = _merged(self._sorted, new)
        return self._sorted

    def add(self, segment: int) -> None:
        """Add an id."""
        if not self._is_sorted_in(segment):
            self.add_new(segment)

    def add_new(self, segment: int) -> None:
        """Add an id that the caller knows to be absent."""
        self._added.add(segment)
        if len(self._added) > _MOST_ADDED:
            self.array()

    def update(self, ids: AnyArray) -> None:
        """Add many ids."""
        new = ascending(ids.astype(ID_DTYPE, copy=False))
        new = new[~self.contains(new)]  # also merges the added ids
        self._sorted = _merged(self._sorted, new)

    def discard(self, segment: int) -> None:
        """Remove an id if it is present."""
        if segment in self._added:
            self._added.discard(segment)
        elif self._is_sorted_in(segment):
            self._sorted = np.delete(self._sorted, np.searchsorted(self._sorted, _id(segment)))

    def difference_update(self, ids: AnyArray) -> None:
        """Remove many ids, those that are present."""
        ids = ascending(ids.astype(ID_DTYPE, copy=False))
        gone = ids[self.contains(ids)]
        if len(gone):
            positions = np.searchsorted(self._sorted, gone)
            self._sorted = np.delete(self._sorted, positions)

    def _is_sorted_in(self, segment: int) -> bool:
        members = self._sorted
        position = int(members.searchsorted(_id(segment)))
        return position < len(members) and int(members[position]) == segment


def ascending(ids: UInt32) -> UInt32:
    """Return ids sorted and unique; three times as fast as ``numpy.unique``."""
    if (ids[1:] > ids[:-1]).all():  # takes a tenth of the time of sorting
        return ids
    ordered = np.sort(ids)
    is_new = np.empty(len(ordered), dtype=np.bool_)
    is_new[0] = True
    np.not_equal(ordered[1:], ordered[:-1], out=is_new[1:])
    return ordered[is_new]


def _merged(one: UInt32, other: UInt32) -> UInt32:
    """Merge two ascending arrays; NumPy's stable sort detects the runs."""
    if not len(other):
        return one
    both = np.concatenate((one, other))
    both.sort(kind="stable")
    return both


def _id(segment: int) -> np.uint32:
    return np.uint32(segment)
