"""Where a vertical plane meets a surface: pieces of lines, and the lines that they make.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64

__all__ = ["joined_lines", "vertical_cut"]

_SAME_M: Final = 1e-7
"""Ends nearer than this are one: far below any mesh's grid, far above what float64 rounds."""


def vertical_cut(
    positions: Float64, faces: Int32, start: tuple[float, float], end: tuple[float, float]
) -> Float64:
    """Cut a surface by the vertical plane over a line on the ground.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float64
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    start, end : (float, float)
        x and z of the line's ends.

    Returns
    -------
    ndarray of shape (L, 2, 2), float64
        Pieces of the cut: both ends, each the distance from the line's start along it, and y.
        Limited to the line; pieces without length are left out. A vertex in the plane counts as
        left of it, so that no face gives a piece twice.

    Examples
    --------
    >>> corners = np.array([[0.0, 1, 0], [4, 5, 0], [0, 1, 4]])
    >>> vertical_cut(corners, np.array([[0, 1, 2]], np.int32), (-1, 1), (9, 1)).tolist()
    [[[1.0, 1.0], [4.0, 4.0]]]
    """
    # (1) Distance of every vertex to the plane, and along it.
    begin = np.array(start)
    along = np.array(end) - begin
    length = float(np.hypot(*along))
    along = along / length
    ground = positions[:, [0, 2]] - begin
    distance = ground @ np.array([-along[1], along[0]])
    left = distance >= 0
    # (2) Faces with corners on both sides: two of their edges are crossed.
    sides = left[faces]
    crossed = faces[(sides.any(axis=1)) & ~(sides.all(axis=1))]
    if len(crossed) == 0:
        return np.zeros((0, 2, 2))
    lone_side = left[crossed].sum(axis=1) == 1
    odd = np.argmax(left[crossed] == lone_side[:, None], axis=1)
    rows = np.arange(len(crossed))
    first, second, third = (crossed[rows, (odd + step) % 3] for step in range(3))
    reach = ground @ along
    pieces = np.stack(
        [
            _crossing(positions, distance, reach, first, second),
            _crossing(positions, distance, reach, first, third),
        ],
        axis=1,
    )
    # (3) From left to right, and no farther than the line.
    turned = pieces[:, 0, 0] > pieces[:, 1, 0]
    pieces[turned] = pieces[turned][:, ::-1]
    return _limited(pieces, length)


def _crossing(
    positions: Float64, distance: Float64, reach: Float64, first: Int32, second: Int32
) -> Float64:
    """Distance along the line and y where edges cross the plane, (N, 2)."""
    # By the ends' places and not by their numbers: two meshes that share an edge agree to the bit.
    swap = _comes_after(positions[first], positions[second])
    a, b = np.where(swap, second, first), np.where(swap, first, second)
    share = distance[a] / (distance[a] - distance[b])
    at = reach[a] + share * (reach[b] - reach[a])
    y = positions[a, 1] + share * (positions[b, 1] - positions[a, 1])
    return np.stack([at, y], axis=1)


def _comes_after(p: Float64, q: Float64) -> Bool:
    """Whether places come after others in the order of x, y, z."""
    after: Bool = p[:, 2] > q[:, 2]
    for axis in (1, 0):
        after = np.where(p[:, axis] == q[:, axis], after, p[:, axis] > q[:, axis])
    return after


def _limited(pieces: Float64, length: float) -> Float64:
    """Cut pieces to 0..length; those beyond it or without length go."""
    low, high = pieces[:, 0], pieces[:, 1]
    keep = (high[:, 0] >= 0) & (low[:, 0] <= length)
    pieces = pieces[keep].copy()
    low, high = pieces[:, 0], pieces[:, 1]
    run = np.maximum(high[:, 0] - low[:, 0], 1e-300)
    slope = (high[:, 1] - low[:, 1]) / run
    before, beyond = low[:, 0] < 0, high[:, 0] > length
    low[before, 1] -= low[before, 0] * slope[before]
    low[before, 0] = 0.0
    high[beyond, 1] -= (high[beyond, 0] - length) * slope[beyond]
    high[beyond, 0] = length
    long: Bool = (pieces[:, 0] != pieces[:, 1]).any(axis=1)
    return pieces[long]


def joined_lines(pieces: Float64) -> list[Float64]:
    """Join pieces that meet to lines.

    Parameters
    ----------
    pieces : ndarray of shape (L, 2, 2), float64
        As from :func:`vertical_cut`.

    Returns
    -------
    list of ndarray of shape (N, 2), float64
        Each piece in one line, but for those of no length; a line goes on where exactly two pieces
        meet. Ordered by where they begin; open ones run towards larger distances; a closed one ends
        where it begins.

    Examples
    --------
    >>> a, b, c = [0.0, 5.0], [1.0, 6.0], [2.0, 5.5]
    >>> [line.tolist() for line in joined_lines(np.array([[b, c], [a, b]]))]
    [[[0.0, 5.0], [1.0, 6.0], [2.0, 5.5]]]
    """
    if len(pieces) == 0:
        return []
    # (1) Ends at the same place become one node; rows of pieces by node.
    places = pieces.reshape(-1, 2)
    _, kept, node = np.unique(
        np.round(places / _SAME_M).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    ends = node.reshape(-1, 2)
    ends = ends[ends[:, 0] != ends[:, 1]]
    degree = np.bincount(ends.ravel(), minlength=len(kept))
    at_node: list[list[int]] = [[] for _ in kept]
    for row, (a, b) in enumerate(ends.tolist()):
        at_node[a].append(row)
        at_node[b].append(row)
    # (2) Walks from where lines end, then round the closed ones. Invariant: a piece is used once.
    used = np.zeros(len(ends), np.bool_)
    lines = []
    corners = places[kept]
    order = np.lexsort((corners[:, 1], corners[:, 0]))
    starts = [*order[degree[order] != 2].tolist(), *order[degree[order] == 2].tolist()]
    for start in starts:
        for row in at_node[start]:
            if not used[row]:
                path = _walk(start, row, ends, at_node, degree, used)
                line = corners[path]
                lines.append(line if line[0, 0] <= line[-1, 0] else line[::-1])
    lines.sort(key=lambda line: tuple(line[0]))
    return lines


def _walk(
    start: int,
    row: int,
    ends: Int64,
    at_node: list[list[int]],
    degree: Int64,
    used: Bool,
) -> list[int]:
    """Follow pieces from a node until a line ends, marking them as used."""
    path = [start]
    while True:
        used[row] = True
        a, b = ends[row].tolist()
        path.append(b if path[-1] == a else a)
        if degree[path[-1]] != 2 or path[-1] == start:
            return path
        onward = [other for other in at_node[path[-1]] if not used[other]]
        if not onward:
            return path
        row = onward[0]
