"""Regions that last: read off a tree at the level where each of them is itself for longest.

One level for a whole scene is too high for weak borders beside each other and too low for one
material whose patches differ. Seen from a region, what tells is how long it *lasts*: from the level
at which its parts came together to the level at which it goes under in a larger one. Patches of one
rock face unite late and go under soon after; a bench in a plain field unites early and stands long.
Of all ways to cut the tree the one is taken in which the ground, square metre by square metre, lies
in regions that last longest.

Levels count from :data:`_LEAST` to :data:`_MOST`: what unites below is no border to anybody, what
stands above is one to everybody. What is too small for a region is part of what it is united with.

PURE: no I/O, no clock. Linear in the tree.

References
----------
R. J. G. B. Campello, D. Moulavi, J. Sander, "Density-based clustering based on hierarchical density
estimates", PAKDD 2013, choose clusters by excess of mass in the same way.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float64, Int32
from terraport_pipeline.geometry.borders.consensus import AgreedTree

__all__ = ["lasting_regions"]

_LEAST: Final = 0.55
"""Level up to which everything is united."""
_MOST: Final = 1.2
"""Level above which nothing is."""


def lasting_regions(tree: AgreedTree) -> Int32:
    """Choose the regions of a tree.

    Parameters
    ----------
    tree : AgreedTree

    Returns
    -------
    ndarray of shape (R,), int32
        Nodes of the tree that are regions: every leaf is under exactly one. Among them are such
        that are too small, where nothing small enough to join was united with them: these are left
        to join a neighbour.

    Notes
    -----
    Of two ways that last equally long the one with fewer regions is taken.
    """
    count = len(tree.area_m2) - len(tree.children)
    return _chosen_nodes(
        count, tree.children, tree.level, tree.area_m2, tree.is_region, _LEAST, _MOST
    )


@numba.njit(cache=True, nogil=True)
def _chosen_nodes(
    leaves: int,
    children: Int32,
    level: Float64,
    area: Float64,
    is_region: Bool,
    least: float,
    most: float,
) -> Int32:
    nodes = leaves + len(children)
    # A node is what its largest part is until two that are regions come together: `split` is the
    # node where that was last, -1 if never; `since` its level, `below` how long what is parted
    # there lasts, `is_cut` whether it stays parted.
    split = np.full(nodes, -1, np.int32)
    since = np.zeros(nodes)
    below = np.zeros(nodes)
    is_cut = np.zeros(nodes, np.bool_)
    has_parent = np.zeros(nodes, np.bool_)
    for merge in range(len(children)):
        node = leaves + merge
        has_parent[children[merge]] = True
        one, other = children[merge]
        if is_region[one] and is_region[other]:
            for child in children[merge]:
                own = area[child] * _lasts(since[child], level[merge], least, most)
                is_cut[child] = _stays_parted(
                    split[child], since[child], level[merge], own, below[child], least, most
                )
                below[node] += below[child] if is_cut[child] else own
            split[node] = node
            since[node] = level[merge]
        else:
            main = one
            if is_region[other] or (not is_region[one] and area[other] > area[one]):
                main = other
            split[node], since[node], below[node] = split[main], since[main], below[main]
    # From the roots down.
    stack = np.empty(nodes, np.int32)
    chosen = np.empty(nodes, np.int32)
    found, waiting = 0, 0
    for node in range(nodes - 1, -1, -1):
        if has_parent[node]:
            continue
        own = area[node] * _lasts(since[node], most, least, most)
        is_cut[node] = _stays_parted(split[node], since[node], most, own, below[node], least, most)
        stack[waiting] = node
        waiting += 1
        while waiting:
            waiting -= 1
            top = stack[waiting]
            if not is_cut[top]:
                chosen[found] = top
                found += 1
                continue
            # What joined on the way down to the split is small: it finds a neighbour later.
            while top != split[top]:
                one, other = children[top - leaves]
                main = one if split[one] == split[top] else other
                chosen[found] = other if main == one else one
                found += 1
                top = main
            for child in children[top - leaves]:
                stack[waiting] = child
                waiting += 1
    return chosen[:found].copy()


@numba.njit(cache=True, inline="always")
def _lasts(since: float, until: float, least: float, most: float) -> float:
    return min(max(until, least), most) - min(max(since, least), most)


@numba.njit(cache=True, inline="always")
def _stays_parted(
    split: int, since: float, until: float, own: float, below: float, least: float, most: float
) -> bool:
    if split < 0 or since <= least:
        return False
    return since > most or (until > least and below > own)
