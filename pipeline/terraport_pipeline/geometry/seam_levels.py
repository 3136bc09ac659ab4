"""Smooth corrections that make photos agree at seams: global levelling.

Waechter, Moehrle, Goesele (ECCV 2014), equation 3 (after Lempitsky & Ivanov, CVPR 2007)::

    minimise  sum over seam vertices: (f_l + g_l - (f_r + g_r))^2
            + 1 / lambda * sum over edges inside charts: (g_i - g_j)^2

with f what the photo on the left or right shows and g the corrections wanted. Their g has one
unknown per vertex and chart. It is smooth, so here one per *cell*: all nodes (vertices as one view
sees them, :mod:`terraport_pipeline.geometry.seams`) of one view in one cube of some eight edges.
That is one unknown in about 64; between the cells' centres g is interpolated, over the cells of its
own view only. What so coarse a field leaves at the seams is closed locally
(:mod:`terraport_pipeline.geometry.seam_blend`).

A weak pull to zero (:data:`_PULL`) makes the solution unique and lets corrections fade over some
thirty edges; the photos' gains have done what goes farther.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
import numpy.typing as npt
from scipy import sparse

from terraport_pipeline.geometry.chunks import in_chunks
from terraport_pipeline.geometry.seams import Nodes, Seams
from terraport_pipeline.model import Float32, Float64, Int32

__all__ = ["LevelField", "level_field", "node_levels"]

_CELL_EDGES: Final = 8.0
"""Side of a cell in mean edges."""

_MAX_SIDE: Final = 2**14 - 2
"""Cells along one axis at most: three axes and a view fit a 64-bit key."""

_STIFFNESS: Final = 0.25
"""Weight of the difference between two cells, per edge of the mesh that runs from one to the other.
A cell boundary of eight edges gives 2, which is 1 / lambda = 2 for a field that changes evenly over
the eight edges between the centres. Waechter's lambda = 0.1 is stiffer, for charts with nothing
else to hold them."""

_PULL: Final = 2e-3
"""Weight of a node's own correction: it fades to 1 / e over sqrt(2 / 2e-3) = 32 edges. With 2e-4
rendered photos came out 0.4 dB worse in the median than with gains alone."""

_TOLERANCE: Final = 1e-4
_MAX_STEPS: Final = 500
"""Conjugate gradients stop at this part of the right side, or here; usual are 50 to 100."""

_Int64 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class LevelField:
    """A correction for every cell; C cells."""

    keys: _Int64
    """(C,) place and view of every cell, ascending."""
    level: Float64
    """(C, 3) sRGB levels."""
    near: Int32
    """(C, 27) cells of the same view around every cell (itself at 13), -1 where there are none."""
    origin: Float64
    """(3,) corner of the cell (0, 0, 0)."""
    size_m: float
    """Side of a cell."""
    steps: int
    """Steps of conjugate gradients that it took."""


def level_field(vertices: Float32, nodes: Nodes, seams: Seams) -> tuple[LevelField, Int32]:
    """Solve for the corrections.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
    nodes : Nodes
    seams : Seams

    Returns
    -------
    field : LevelField
    cell : ndarray of shape (N,), int32
        Cell of every node.
    """
    origin = vertices.min(axis=0).astype(np.float64) if len(vertices) else np.zeros(3)
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    edge = _mean_edge(vertices, nodes.corner, nodes.vertex)
    size = max(_CELL_EDGES * edge, extent / _MAX_SIDE, 1e-9)
    key_of_node = _cell_keys(vertices, nodes.vertex, nodes.view, origin, size)
    keys, inverse = np.unique(key_of_node, return_inverse=True)
    cell = inverse.astype(np.int32)
    links = _crossing_edges(nodes.corner, cell)
    n_cells = len(keys)
    ones = np.full(len(links), _STIFFNESS)
    one, two = links[:, 0], links[:, 1]
    ends = cell[seams.node].reshape(-1, 2)
    weight = np.repeat(0.5 * seams.weight.astype(np.float64) * seams.trust, 2)
    step = np.repeat(seams.step.astype(np.float64), 2, axis=0)
    rows = np.concatenate([one, two, ends[:, 0], ends[:, 1]])
    columns = np.concatenate([two, one, ends[:, 1], ends[:, 0]])
    values = np.concatenate([ones, ones, weight, weight])
    matrix = sparse.coo_array((values, (rows, columns)), shape=(n_cells, n_cells)).tocsr()
    diagonal = np.asarray(matrix.sum(axis=1)).ravel()
    diagonal += _PULL * np.bincount(cell, minlength=n_cells) + 1e-12
    right = np.zeros((n_cells, 3))
    for k in range(3):
        pull = weight * step[:, k]
        right[:, k] = np.bincount(ends[:, 1], pull, n_cells) - np.bincount(
            ends[:, 0], pull, n_cells
        )
    level, steps = _conjugate_gradients(
        diagonal, matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data,
        right, _TOLERANCE, _MAX_STEPS,
    )  # fmt: skip
    return LevelField(keys, level, _near_cells(keys), origin, size, int(steps)), cell


def node_levels(
    field: LevelField, vertices: Float32, nodes: Nodes, cell: Int32, *, threads: int = 1
) -> Float32:
    """Interpolate the field at every node, (N, 3) float32: trilinear over its view's own cells."""
    levels = np.empty((len(nodes.vertex), 3), np.float32)
    in_chunks(
        lambda begin, end: _interpolate(
            field.level, field.near, field.origin, field.size_m, vertices, nodes.vertex, cell,
            levels, begin, end,
        ),
        len(levels), threads=threads,
    )  # fmt: skip
    return levels


@numba.njit(cache=True, nogil=True)
def _mean_edge(vertices: Float32, corner: Int32, vertex: Int32) -> float:
    total, count = 0.0, 0
    for f in range(0, len(corner), 7):
        a, b = vertex[corner[f, 0]], vertex[corner[f, 1]]
        square = 0.0
        for k in range(3):
            square += (np.float64(vertices[a, k]) - vertices[b, k]) ** 2
        total += np.sqrt(square)
        count += 1
    return total / count if count else 0.0


@numba.njit(cache=True, nogil=True)
def _cell_keys(
    vertices: Float32, vertex: Int32, view: Int32, origin: Float64, size: float
) -> _Int64:
    keys = np.empty(len(vertex), np.int64)
    for n in range(len(vertex)):
        key = 0
        for k in range(3):
            # from 1 on, so that a neighbour's number never borrows from the next axis
            key = (key << 14) | (int((vertices[vertex[n], k] - origin[k]) / size) + 1)
        keys[n] = (key << 16) | (view[n] + 2)
    return keys


@numba.njit(cache=True, nogil=True)
def _crossing_edges(corner: Int32, cell: Int32) -> Int32:
    """Cells at both ends of every face's edge that runs from one cell to another."""
    count = 0
    for f in range(len(corner)):
        for c in range(3):
            if cell[corner[f, c]] != cell[corner[f, (c + 1) % 3]]:
                count += 1
    found = np.empty((count, 2), np.int32)
    n = 0
    for f in range(len(corner)):
        for c in range(3):
            a, b = cell[corner[f, c]], cell[corner[f, (c + 1) % 3]]
            if a != b:
                found[n, 0], found[n, 1] = a, b
                n += 1
    return found


@numba.njit(cache=True, nogil=True)
def _near_cells(keys: _Int64) -> Int32:
    near = np.empty((len(keys), 27), np.int32)
    for c in range(len(keys)):
        for n in range(27):
            dx, dy, dz = n // 9 - 1, (n // 3) % 3 - 1, n % 3 - 1
            wanted = keys[c] + ((((dx << 14) + dy) << 14) + dz) * 65536
            at = np.searchsorted(keys, wanted)
            near[c, n] = at if at < len(keys) and keys[at] == wanted else -1
    return near


@numba.njit(cache=True, nogil=True)
def _conjugate_gradients(
    diagonal: Float64,
    starts: _Int64,
    columns: Int32,
    values: Float64,
    right: Float64,
    tolerance: float,
    max_steps: int,
) -> tuple[Float64, int]:
    """Solve (diagonal - values) x = right for three right sides, preconditioned by the diagonal.

    Here and not SciPy's, whose sums depend on the number of BLAS threads.
    """
    n = len(diagonal)
    x = np.zeros((n, 3))
    product = np.empty(n)
    most = 0
    for k in range(3):
        residual = right[:, k].copy()
        goal = 0.0
        rz = 0.0
        direction = np.empty(n)
        for i in range(n):
            direction[i] = residual[i] / diagonal[i]
            rz += residual[i] * direction[i]
            goal += residual[i] * residual[i]
        goal *= tolerance * tolerance
        if goal == 0.0:
            continue
        for number in range(max_steps):
            curvature = 0.0
            for i in range(n):
                total = diagonal[i] * direction[i]
                for e in range(starts[i], starts[i + 1]):
                    total -= values[e] * direction[columns[e]]
                product[i] = total
                curvature += total * direction[i]
            length = rz / curvature
            square, new_rz = 0.0, 0.0
            for i in range(n):
                x[i, k] += length * direction[i]
                residual[i] -= length * product[i]
                square += residual[i] * residual[i]
                new_rz += residual[i] * residual[i] / diagonal[i]
            most = max(most, number + 1)
            if square <= goal:
                break
            for i in range(n):
                direction[i] = residual[i] / diagonal[i] + new_rz / rz * direction[i]
            rz = new_rz
    return x, most


@numba.njit(cache=True, nogil=True)
def _interpolate(
    level: Float64,
    near: Int32,
    origin: Float64,
    size: float,
    vertices: Float32,
    vertex: Int32,
    cell: Int32,
    levels: Float32,
    begin: int,
    end: int,
) -> None:
    part = np.empty(3)
    side = np.empty(3, np.int64)
    for n in range(begin, end):
        for k in range(3):
            place = (vertices[vertex[n], k] - origin[k]) / size
            inside = place - np.floor(place) - 0.5
            side[k] = 1 if inside >= 0.0 else -1
            part[k] = abs(inside)
        mass = 0.0
        total0, total1, total2 = 0.0, 0.0, 0.0
        for corner in range(8):
            weight = 1.0
            at = 13
            stride = 9
            for k in range(3):
                if (corner >> k) & 1:
                    weight *= part[k]
                    at += stride * side[k]
                else:
                    weight *= 1.0 - part[k]
                stride //= 3
            other = near[cell[n], at]
            if other < 0 or weight == 0.0:
                continue
            mass += weight
            total0 += weight * level[other, 0]
            total1 += weight * level[other, 1]
            total2 += weight * level[other, 2]
        levels[n, 0], levels[n, 1], levels[n, 2] = total0 / mass, total1 / mass, total2 / mass
