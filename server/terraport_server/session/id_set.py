"""A set of segment ids that costs what is in it, not what the scene has.

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
"""Ids kept in a Python set (some 60 bytes each) before they are sorted in among the others."""

_NONE: Final = np.zeros(0, dtype=ID_DTYPE)


class IdSet:
    """Segment ids: 4 bytes each, added one by one, asked for many at a time.

    A landing adds its segments as they are sent, and asks of all candidates of the next one at
    once. So single ids gather in a small Python set and are sorted in when many are asked for. A
    session of an idle client in a scene of a million segments takes a few hundred bytes; an array
    of a million booleans would take a megabyte, however little it holds.

    Parameters
    ----------
    ids
        What is in it at first, in any order; repeated ones count once.

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
        """Disjoint from the sorted ones."""

    @classmethod
    def of_sorted(cls, ids: UInt32) -> IdSet:
        """Return a set of ids that are ascending, each once, and not written to any more."""
        id_set = cls()
        id_set._sorted = ids
        return id_set

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._sorted) + len(self._added)

    def __contains__(self, segment: int) -> bool:
        """Return whether one id is in it."""
        return segment in self._added or self._is_sorted_in(segment)

    def contains(self, ids: AnyInt) -> Bool:
        """Return for each id whether it is in the set."""
        members = self.array()
        if len(members) == 0 or len(ids) == 0:
            return np.zeros(len(ids), dtype=np.bool_)
        asked = ids.astype(ID_DTYPE, copy=False)  # another type would copy all of `members`
        positions = np.searchsorted(members, asked)
        positions[positions == len(members)] = 0
        is_member: Bool = members[positions] == asked
        return is_member

    def array(self) -> UInt32:
        """Return all ids, ascending. The caller must not write to it."""
        if self._added:
            new = np.fromiter(self._added, dtype=ID_DTYPE, count=len(self._added))
            self._added.clear()
            new.sort()
            self._sorted = _merged(self._sorted, new)
        return self._sorted

    def add(self, segment: int) -> None:
        """Put one id in."""
        if not self._is_sorted_in(segment):
            self.add_new(segment)

    def add_new(self, segment: int) -> None:
        """Put one id in that the caller knows not to be in."""
        self._added.add(segment)
        if len(self._added) > _MOST_ADDED:
            self.array()

    def update(self, ids: AnyArray) -> None:
        """Put many ids in."""
        new = ascending(ids.astype(ID_DTYPE, copy=False))
        new = new[~self.contains(new)]  # which also sorts in what was added
        self._sorted = _merged(self._sorted, new)

    def discard(self, segment: int) -> None:
        """Take one id out, where it is in."""
        if segment in self._added:
            self._added.discard(segment)
        elif self._is_sorted_in(segment):
            self._sorted = np.delete(self._sorted, np.searchsorted(self._sorted, _id(segment)))

    def difference_update(self, ids: AnyArray) -> None:
        """Take many ids out, where they are in."""
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
    """Return ids ascending, each once.

    To search for them in order is three times as fast, and NumPy's ``unique`` three times as slow.
    """
    if (ids[1:] > ids[:-1]).all():  # a tenth of sorting
        return ids
    ordered = np.sort(ids)
    is_new = np.empty(len(ordered), dtype=np.bool_)
    is_new[0] = True
    np.not_equal(ordered[1:], ordered[:-1], out=is_new[1:])
    return ordered[is_new]


def _merged(one: UInt32, other: UInt32) -> UInt32:
    """Return two ascending arrays as one; NumPy's stable sort merges runs."""
    if not len(other):
        return one
    both = np.concatenate((one, other))
    both.sort(kind="stable")
    return both


def _id(segment: int) -> np.uint32:
    return np.uint32(segment)
