"""What is missing between two surfaces that end in one wall: closed loops around it.

Edges that run along the wall in opposite directions on both sides cancel. The rest, reversed, is
the boundary of what is missing. Most of it closes; where it does not, both polylines end:

- far from all samples, where each solver's own surface ends: there they part for good;
- on a line where walls meet, and go on in the next wall. Flat ground that grazes a wall parts so:
  each tile's surface is a hair beyond the wall, where it is the other's, and both leave out metres.

Such ends are bridged: each to its nearest. On a line where walls meet the bridges of all walls run
along the line and close up among themselves, so nothing is left open between them; the others lie
where the surface is cut away.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from terraport_payload.types import Bool, Float64, Int64, UInt8
from terraport_pipeline.geometry.mesh.loop_fill import directed_loops

__all__ = ["ON_LINE_CELLS", "missing_loops"]

_MAX_LOOP: Final = 4000
"""Vertices of a loop that is filled; cutting it takes their square."""

_MAX_CAP_CELLS: Final = 8.0
"""A loop of one side alone (a bubble that the other side lacks) is capped up to this wide."""

_MAX_ENDS: Final = 2000
"""Ends in one wall that are bridged; their distances are held in memory."""

ON_LINE_CELLS: Final = 1e-6
"""Vertices on one line agree in two axes, which hold whole numbers there."""


def missing_loops(
    edges: Int64, side: UInt8, cells: Float64, at_line: Bool
) -> tuple[list[Int64], int]:
    """Find loops that bound what is missing between both sides; count edges in none.

    Parameters
    ----------
    edges : ndarray of shape (E, 2), int64
        Of both sides, joined vertices by one number.
    side : ndarray of shape (E,), uint8
        0 below the wall, 1 above.
    cells : ndarray of shape (V, 3), float64
        Positions of all vertices, lattice cells.
    at_line : ndarray of shape (V,), bool
        Vertices on a line where walls meet.

    Returns
    -------
    loops : list of ndarray of shape (n,), int64
        Vertices, in the fillers' own direction.
    open_edges : int
        Edges that no loop bounds: one side ends there.
    """
    proper = edges[:, 0] != edges[:, 1]
    edges, side = edges[proper], side[proper]
    # (1) Cancel: an edge of one side with its opposite on the other, one for one.
    ordered = np.sort(edges, axis=1)
    forward = (edges[:, 0] == ordered[:, 0]).astype(np.int64)
    unique, which = np.unique(ordered, axis=0, return_inverse=True)
    balance = np.bincount(which.ravel(), 2 * forward - 1, minlength=len(unique)).astype(np.int64)
    left = np.flatnonzero(balance)
    if not len(left):
        return [], 0
    # Reversed: the fillers' own direction.
    turned = np.where((balance[left] > 0)[:, None], unique[left][:, ::-1], unique[left])
    repeated = np.repeat(turned, np.abs(balance[left]), axis=0)
    side_of_edge = {
        tuple(sorted(edge)): int(s) for edge, s in zip(edges.tolist(), side.tolist(), strict=True)
    }
    # (2) Close, and take apart into loops. Bridges have no side.
    bridges = _bridges(repeated, cells, at_line)
    loops, open_edges = directed_loops(np.concatenate([repeated, bridges]))
    # (3) Keep those that lie between both sides, and small ones that one side lacks.
    kept = []
    for loop in loops:
        around = list(zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True))
        sides = [side_of_edge.get((min(u, v), max(u, v))) for u, v in around]
        bridged = sides.count(None)
        is_closed = all(
            at_line[[u, v]].all() for (u, v), s in zip(around, sides, strict=True) if s is None
        )
        wide = float(np.ptp(cells[loop], axis=0).max())
        is_between = {0, 1} <= set(sides)
        is_bubble = is_closed and wide <= _MAX_CAP_CELLS
        if len(loop) <= _MAX_LOOP and (is_between or is_bubble):
            kept.append(loop)
        else:
            open_edges += len(loop) - bridged
    return kept, open_edges


def _bridges(edges: Int64, cells: Float64, at_line: Bool) -> Int64:
    """Edges (K, 2) from where a path ends to where one begins, the nearest first."""
    vertices, places = np.unique(edges, return_inverse=True)
    places = places.reshape(-1, 2)
    # An edge by itself bounds nothing; a tile whose earlier fillers are held has its bridges so.
    degree = np.bincount(places.ravel(), minlength=len(vertices))
    places = places[(degree[places] > 1).any(axis=1)]
    leaving = np.bincount(places[:, 0], minlength=len(vertices))
    arriving = np.bincount(places[:, 1], minlength=len(vertices))
    ends = np.repeat(vertices, np.maximum(arriving - leaving, 0))
    begins = np.repeat(vertices, np.maximum(leaving - arriving, 0))
    if not len(ends) or len(ends) > _MAX_ENDS:
        return np.zeros((0, 2), np.int64)
    gap = cdist(cells[ends], cells[begins])
    # On a line where walls meet: to another on the same line, or to none.
    off = np.abs(cells[ends][:, None] - cells[begins][None]) > ON_LINE_CELLS
    is_one_line = at_line[ends][:, None] & at_line[begins][None] & (off.sum(axis=2) < 2)
    is_free = ~at_line[ends][:, None] & ~at_line[begins][None]
    gap[~(is_one_line | is_free)] = np.inf
    taken_ends, taken_begins = np.zeros(len(ends), bool), np.zeros(len(begins), bool)
    bridges = []
    for at in np.argsort(np.round(gap, 9), axis=None, kind="stable"):
        end, begin = divmod(int(at), len(begins))
        if not np.isfinite(gap[end, begin]):
            break
        if taken_ends[end] or taken_begins[begin]:
            continue
        taken_ends[end] = taken_begins[begin] = True
        bridges.append((ends[end], begins[begin]))
    return np.array(bridges, dtype=np.int64).reshape(-1, 2)
