"""Numbers of regions over the next survey: what did not change keeps its region and its number.

A region is a list of units, the pieces that tiles were cut into before all tiles were joined. The
join looks at the whole scene, so a change in one tile may unite units far from it in another way. A
unit of a tile that did not change therefore stays in the region it had (it is *held*), and the
units of changed tiles follow the region of the join that they are in: to the region before that it
continues, or to a new one.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyInt, Float64, Int32, Int64
from terraport_pipeline.geometry.regions.region_match import MIN_SIMILARITY

__all__ = ["RegionNumbers", "carry_numbers", "local_numbers"]

_NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class RegionNumbers:
    """Regions of all units, numbered without gaps."""

    region: Int32
    """(U,) region of every unit."""
    before: Int32
    """(R,) number that every region had before; -1 of a new one."""

    @property
    def count(self) -> int:
        """Number of regions."""
        return len(self.before)

    @classmethod
    def anew(cls, joined: Int32) -> RegionNumbers:
        """Keep the numbers of the join; nothing was there before."""
        count = int(joined.max(initial=-1)) + 1
        return cls(joined, np.full(count, _NONE, np.int32))


def carry_numbers(
    joined: Int32, held: Int32, area: Float64, matched: tuple[Int32, Int32]
) -> RegionNumbers:
    """Give the regions of a new surface numbers, by those of the surface before.

    Parameters
    ----------
    joined : ndarray of shape (U,), int32
        Region of every unit as the join of all tiles has it, 0.. without gaps.
    held : ndarray of shape (U,), int32
        Region before of the units of tiles that did not change; -1 of all others.
    area : ndarray of shape (U,), float64
        Square metres of every unit.
    matched : pair of ndarray of shape (M,), int32
        Regions of the join, and the regions before that they continue; each at most once.

    Returns
    -------
    RegionNumbers
        Every region has a unit. Held units have the region they had, under its old number where
        that is below the number of regions; above, it moves to the lowest number that is free after
        new regions took theirs.

    Examples
    --------
    >>> matched = np.array([1]), np.array([0])
    >>> joined, held = np.array([0, 1, 1, 2]), np.array([4, 0, -1, -1])
    >>> numbers = carry_numbers(joined, held, np.ones(4), matched)
    >>> numbers.region.tolist(), numbers.before.tolist()
    ([2, 0, 0, 1], [0, -1, 4])
    """
    # (1) The region before that each region of the join continues: its match, or else the one that
    # holds enough of it. Without the second rule a region that changed much would end along the
    # border of the tiles that changed.
    count = int(joined.max(initial=-1)) + 1
    continued = _mostly_held(joined, held, area, count)
    continued[np.isin(continued, matched[1])] = _NONE  # what another region of the join continues
    continued[matched[0]] = matched[1]
    # (2) Labels of all units: old numbers, and behind all of those one for each new region.
    behind = max(int(held.max(initial=-1)), int(continued.max(initial=-1))) + 1
    label = np.where(held >= 0, held, continued[joined]).astype(np.int64)
    label = np.where(label >= 0, label, behind + joined.astype(np.int64))
    used, unit_row = np.unique(label, return_inverse=True)
    # (3) Numbers without gaps: old ones stay where they are below the count; new regions take the
    # free numbers, then old ones from beyond.
    stays = used < min(behind, len(used))
    is_free = np.ones(len(used), np.bool_)
    is_free[used[stays]] = False
    moving = np.flatnonzero(~stays)
    moving = np.concatenate([moving[used[moving] >= behind], moving[used[moving] < behind]])
    number: Int64 = used.copy()
    number[moving] = np.flatnonzero(is_free)
    before = np.empty(len(used), np.int32)
    before[number] = np.where(used < behind, used, _NONE)
    return RegionNumbers(number[unit_row.ravel()].astype(np.int32), before)


def local_numbers(labels: AnyInt) -> Int32:
    """Rename labels to 0, 1, 2, ... in the order of their first occurrence.

    Examples
    --------
    >>> local_numbers(np.array([7, 3, 7, 9])).tolist()
    [0, 1, 0, 2]
    """
    _, first, which = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int32)
    rank[np.argsort(first)] = np.arange(len(first), dtype=np.int32)
    return rank[which.ravel()]


def _mostly_held(joined: Int32, held: Int32, area: Float64, count: int) -> Int64:
    """Region before that holds most of each region of the join, and enough; -1 where none does."""
    whole = np.bincount(joined, area, count)
    rows = np.flatnonzero(held >= 0)
    span = int(held.max(initial=-1)) + 1
    pairs, which = np.unique(joined[rows].astype(np.int64) * span + held[rows], return_inverse=True)
    shared = np.bincount(which.ravel(), area[rows], len(pairs))
    region, old = np.divmod(pairs, max(span, 1))
    continued: Int64 = np.full(count, _NONE, np.int64)
    enough = shared >= MIN_SIMILARITY * whole[region]
    order = np.lexsort((-old, shared))  # the last one written is the largest, then the lowest
    order = order[enough[order]]
    continued[region[order]] = old[order]
    return continued
