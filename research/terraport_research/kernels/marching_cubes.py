"""Marching cubes over a narrow band of cells, with a table that is computed, not copied.

W. E. Lorensen and H. E. Cline, "Marching cubes: a high resolution 3D surface construction
algorithm", SIGGRAPH 1987. Their 15 cases leave holes where two cells resolve a shared face
differently; here every face decides by its own four corners alone, always keeping the inside
corners apart, so neighbouring cells agree and the surface has no cracks (as G. M. Nielson and
B. Hamann, "The asymptotic decider", 1991, demand of any rule).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["CORNERS", "case_table", "march"]


CORNERS: Final = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)], np.int64)
"""(8, 3) offsets of a cell's corners; corner c has the bits of x, y, z."""

_EDGES: Final = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
_FACES: Final = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
"""Corners of the six faces, counter-clockwise seen from outside the cell."""


def case_table() -> tuple[Int32, Int32]:
    """Compute the triangles of every case.

    Returns
    -------
    triangles : ndarray of shape (256, T, 3), int32
        Edges of a cell that each triangle's corners lie on; bit c of the case is set where corner
        c is inside (negative). Counter-clockwise seen from outside the body. Rows beyond the count
        are 0.
    counts : ndarray of shape (256,), int32
        Triangles of each case.
    """
    number = {frozenset(edge): i for i, edge in enumerate(_EDGES)}
    cases: list[list[tuple[int, int, int]]] = []
    for case in range(256):
        follows: dict[int, int] = {}
        for face in _FACES:
            follows |= _segments(case, face, number)
        triangles = []
        while follows:
            first, then = follows.popitem()
            loop = [first]
            while then != first:
                loop.append(then)
                then = follows.pop(then)
            triangles += [(loop[0], loop[i], loop[i + 1]) for i in range(1, len(loop) - 1)]
        cases.append(triangles)
    counts = np.array([len(triangles) for triangles in cases], np.int32)
    table = np.zeros((256, int(counts.max()), 3), np.int32)
    for case, triangles in enumerate(cases):
        for i, triangle in enumerate(triangles):
            table[case, i] = triangle
    return table, counts


def _segments(
    case: int, face: tuple[int, int, int, int], number: dict[frozenset[int], int]
) -> dict[int, int]:
    """Lines of the surface on one face, each from edge to edge round one run of inside corners."""
    inside = [bool(case >> corner & 1) for corner in face]
    lines = {}
    for k in range(4):
        if inside[k] and not inside[k - 1]:  # a run begins at k
            end = k
            while inside[(end + 1) % 4]:
                end += 1
            entry = number[frozenset((face[k - 1], face[k]))]
            leave = number[frozenset((face[end % 4], face[(end + 1) % 4]))]
            lines[entry] = leave
    return lines


_TABLE, _COUNTS = case_table()


def march(
    cells: Int64, values: Float64, node_keys: Int64, shape: tuple[int, int, int]
) -> tuple[Float32, Int32]:
    """Extract the zero surface of a field that is known in some cells.

    Parameters
    ----------
    cells : ndarray of shape (C, 3), int64
        Cells to march, by the grid position of their lowest corner. Different from each other.
    values : ndarray of shape (M,), float64
        The field at the nodes, negative inside; NaN where it is not known: cells with such a corner
        are left out, which opens the surface.
    node_keys : ndarray of shape (M,), int64
        Each node's ``(x * shape[1] + y) * shape[2] + z``, ascending; every corner of every cell.
    shape : (int, int, int)
        Nodes of the grid along each axis.

    Returns
    -------
    vertices : ndarray of shape (V, 3), float32
        In cells of the grid.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside. Edges of known cells have two faces.
    """
    strides = np.array([shape[1] * shape[2], shape[2], 1], np.int64)
    corner = np.searchsorted(node_keys, (cells @ strides)[:, None] + CORNERS @ strides)
    field = values[corner]
    valid = ~np.isnan(field).any(axis=1)
    corner, field = corner[valid], field[valid]
    case = ((field < 0) << np.arange(8)).sum(axis=1)
    mixed = _COUNTS[case] > 0
    corner, case = corner[mixed], case[mixed]
    count = _COUNTS[case]
    owner = np.repeat(np.arange(len(case)), count)
    slot = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    edge = _TABLE[case[owner], slot]  # (F, 3)
    ends = np.array(_EDGES, np.int64)[edge]  # (F, 3, 2)
    nodes = corner[owner[:, None, None], ends]
    keys = nodes[..., 0] * len(node_keys) + nodes[..., 1]  # the lower corner has the lower key
    unique, faces = np.unique(keys, return_inverse=True)
    low, high = unique // len(node_keys), unique % len(node_keys)
    at_low, at_high = values[low], values[high]
    share = at_low / np.where(at_low == at_high, 1.0, at_low - at_high)
    # Not quite at the nodes: triangles that shrink to a point would break the surface's edges.
    share = np.clip(share, 1e-3, 1 - 1e-3)[:, None]
    vertices = _positions(node_keys[low], shape) * (1 - share)
    vertices += _positions(node_keys[high], shape) * share
    return vertices.astype(np.float32), faces.reshape(-1, 3).astype(np.int32)


def _positions(keys: Int64, shape: tuple[int, int, int]) -> Float64:
    x, rest = np.divmod(keys, shape[1] * shape[2])
    y, z = np.divmod(rest, shape[2])
    return np.stack([x, y, z], axis=1).astype(np.float64)
