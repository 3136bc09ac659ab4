"""The graph of mesh pieces ("units") that segments are merged from, and the merge steps on it.

A unit is an edge-connected set of faces inside one pool and one region. Two units are neighbours
when they share an edge; the *border* between them is the summed length of those edges. Lengths are
held as whole numbers of a fixed fraction of the longest edge, so that sums are exact and no result
depends on the order of summation, hence none on the numbering of the vertices.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.unit_rows import combine_rows, contract_rows, rows_of_labels

__all__ = [
    "UnitGraph",
    "Units",
    "contract",
    "join_small",
    "join_within_bounds",
    "merge_units",
    "unit_graph",
]


_COMPACTNESS: Final = 0.25
"""Weight of the border share against the difference of mean s when small units choose whom to join.
0 follows similarity alone and leaves ragged, interleaved segments; beyond 1 shape overrules
colour."""


@dataclass(frozen=True, slots=True, eq=False)
class UnitGraph:
    """Neighbours of every unit as CSR, each neighbour once, ascending."""

    offsets: Int64
    """(U+1,) row starts."""
    neighbours: Int32
    """(E,) unit numbers; every contact appears in both rows."""
    border: Int64
    """(E,) border length in whole steps, >= 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Units:
    """What is known of every unit; row u belongs to unit u."""

    size: Int64
    """(U,) faces."""
    total: Float64
    """(U,) sum of the similarity index s of its faces."""
    region: Int32
    """(U,) region of its largest part."""
    low: Float32
    """(U, 3) least corner of its box, metres."""
    high: Float32
    """(U, 3) greatest corner of its box, metres."""


def unit_graph(labels: Int32, count: int, pairs: Int32, lengths: Int64) -> UnitGraph:
    """Build the graph of units from pairs of neighbouring faces.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        Unit of every face, 0..count-1.
    count : int
        Number of units.
    pairs : ndarray of shape (P, 2), int32
        Faces that share an edge.
    lengths : ndarray of shape (P,), int64
        Length of the shared edge in whole steps.

    Returns
    -------
    UnitGraph
    """
    return UnitGraph(*combine_rows(*rows_of_labels(labels, count, pairs, lengths)))


def contract(graph: UnitGraph, nodes: Int32, count: int) -> UnitGraph:
    """Graph between unions of units: ``nodes[u]`` is the union that unit u belongs to."""
    return UnitGraph(*contract_rows(graph.offsets, graph.neighbours, graph.border, nodes, count))


def merge_units(units: Units, nodes: Int32, count: int) -> Units:
    """Facts of unions of units; a union's region is its largest unit's (tie: lowest number)."""
    size = np.zeros(count, np.int64)
    np.add.at(size, nodes, units.size)
    low = np.full((count, 3), np.inf, np.float32)
    high = np.full((count, 3), -np.inf, np.float32)
    np.minimum.at(low, nodes, units.low)
    np.maximum.at(high, nodes, units.high)
    order = np.lexsort((np.arange(len(nodes)), -units.size, nodes))
    first = order[np.searchsorted(nodes[order], np.arange(count))]
    total = np.bincount(nodes, weights=units.total, minlength=count).astype(np.float64)
    return Units(size, total, units.region[first], low, high)


def join_small(graph: UnitGraph, units: Units, min_faces: int, *, across_regions: bool) -> Int32:
    """Let every unit below ``min_faces`` join its best neighbour once, whatever the size.

    Parameters
    ----------
    graph, units
        The units and their contacts.
    min_faces : int
        Units with fewer faces look for a partner.
    across_regions : bool
        False: only neighbours of the same region count. True: any neighbour does.

    Returns
    -------
    ndarray of shape (U,), int32
        For every unit the lowest unit of its union (itself where nothing happened).

    Notes
    -----
    Best is the least ``|mean s difference| + 0.25 * (1 - share of the unit's border)``; ties go to
    the longer border, then the lower number.
    """
    return _join_small(
        graph.offsets, graph.neighbours, graph.border, units.size, units.total / units.size,
        units.region, min_faces, across_regions, _COMPACTNESS,
    )  # fmt: skip


def join_within_bounds(
    graph: UnitGraph,
    units: Units,
    min_faces: int,
    max_faces: int,
    max_extent_m: float,
    *,
    across_regions: bool,
) -> Int32:
    """Let units below ``min_faces`` join a neighbour once if the union keeps both upper bounds.

    Smallest first; a unit that took part in a join waits for the next round, so that bounds are
    never exceeded by two joins at once.

    Parameters
    ----------
    graph, units
        The units and their contacts.
    min_faces, max_faces : int
        Who looks for a partner, and the most faces a union may have.
    max_extent_m : float
        Longest side of the union's box, metres.
    across_regions : bool
        Whether neighbours of another region count.

    Returns
    -------
    ndarray of shape (U,), int32
        For every unit the lowest unit of its union.
    """
    order = np.lexsort((np.arange(len(units.size)), units.size))
    order = order[units.size[order] < min_faces]
    return _join_within_bounds(
        graph.offsets, graph.neighbours, graph.border, units.size, units.total / units.size,
        units.region, units.low, units.high, order, max_faces, max_extent_m, across_regions,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _root(parent: Int32, item: int) -> int:
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


@numba.njit(cache=True, nogil=True)
def _join_small(
    offsets: Int64,
    neighbours: Int32,
    border: Int64,
    size: Int64,
    mean: Float64,
    region: Int32,
    min_faces: int,
    across_regions: bool,
    compactness: float,
) -> Int32:
    """Unite every small unit with its most similar neighbour; lowest unit of every unit's union.

    Parameters
    ----------
    offsets, neighbours, border : ndarray
        The units' graph as CSR, with the length of every border in steps.
    size, mean, region : ndarray of shape (U,)
        Faces, mean similarity index and region of every unit.
    min_faces : int
        Units below this are small.
    across_regions : bool
        Whether a unit may join one of another region.
    compactness : float
        Weight of the border's share of the perimeter beside the difference of the means.
    """
    count = len(size)
    parent = np.arange(count).astype(np.int32)
    for u in range(count):
        if size[u] >= min_faces:
            continue
        # (1) The neighbour of least cost: alike in the mean, with a long common border.
        perimeter = 0
        for e in range(offsets[u], offsets[u + 1]):
            perimeter += border[e]
        best, best_cost, best_border = -1, np.inf, 0
        for e in range(offsets[u], offsets[u + 1]):
            v = neighbours[e]
            if not across_regions and region[v] != region[u]:
                continue
            cost = abs(mean[v] - mean[u]) + compactness * (1.0 - border[e] / perimeter)
            if cost < best_cost or (cost == best_cost and border[e] > best_border):
                best, best_cost, best_border = v, cost, border[e]
        # (2) Invariant: a root is the lowest unit of its tree, and every other unit's parent lies
        # below it.
        if best >= 0:
            a, b = _root(parent, u), _root(parent, int(best))
            parent[max(a, b)] = min(a, b)
    # (3) Lower units first, so one step reaches the root.
    for u in range(count):
        parent[u] = parent[parent[u]]
    return parent


@numba.njit(cache=True, nogil=True)
def _join_within_bounds(
    offsets: Int64,
    neighbours: Int32,
    border: Int64,
    size: Int64,
    mean: Float64,
    region: Int32,
    low: Float32,
    high: Float32,
    order: Int64,
    max_faces: int,
    max_extent_m: float,
    across_regions: bool,
) -> Int32:
    """Unite units in pairs, small ones first, within both bounds; the lower unit of every pair.

    Parameters
    ----------
    offsets, neighbours, border, size, mean, region, across_regions
        As for :func:`_join_small`.
    low, high : ndarray of shape (U, 3), float32
        Box of every unit, metres.
    order : ndarray, int64
        Units that may choose, in their order.
    max_faces : int
        Largest union.
    max_extent_m : float
        Longest side of its box.
    """
    # Invariant: a unit takes part in one join at most (then it is locked), so sizes and boxes are
    # those of the start of the round and no join breaks a bound.
    count = len(size)
    parent = np.arange(count).astype(np.int32)
    locked = np.zeros(count, np.bool_)
    for i in range(len(order)):
        u = order[i]
        if locked[u]:
            continue
        # (1) Length of the unit's own border.
        perimeter = 0
        for e in range(offsets[u], offsets[u + 1]):
            perimeter += border[e]
        # (2) The neighbour of least cost among those that stay within both bounds.
        best, best_cost = -1, np.inf
        for e in range(offsets[u], offsets[u + 1]):
            v = neighbours[e]
            if size[u] + size[v] > max_faces or (not across_regions and region[v] != region[u]):
                continue
            side = 0.0
            for axis in range(3):
                reach = max(high[u, axis], high[v, axis]) - min(low[u, axis], low[v, axis])
                side = max(side, reach)
            if side > max_extent_m:
                continue
            cost = abs(mean[v] - mean[u]) + side / max_extent_m - border[e] / perimeter
            if cost < best_cost:
                best, best_cost = v, cost
        # (3) The lower unit goes on; of a locked neighbour nothing is taken in this round.
        if best >= 0 and not locked[best]:
            parent[max(u, best)] = min(u, best)
            locked[u] = locked[best] = True
    return parent
