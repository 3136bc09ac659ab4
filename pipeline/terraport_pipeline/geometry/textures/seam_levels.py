"""Smooth corrections that make photos agree at seams: global levelling.

Waechter, Moehrle, Goesele (ECCV 2014), equation 3 (after Lempitsky & Ivanov, CVPR 2007)::

    minimise  sum over seam vertices: (f_l + g_l - (f_r + g_r))^2
            + 1 / lambda * sum over edges inside charts: (g_i - g_j)^2

with f what the photo on the left or right shows and g the corrections wanted. Their g has one
unknown per vertex and chart. It is smooth, so here one per *cell*: all nodes (vertices as one view
sees them, :mod:`terraport_pipeline.geometry.textures.seams`) of one view in one cube of some eight
edges. That is one unknown in about 64; between the cells' centres g is interpolated, over the
cells of its own view only. What so coarse a field leaves at the seams is closed locally
(:mod:`terraport_pipeline.geometry.textures.seam_blend`).

A weak pull to zero (in :mod:`~terraport_pipeline.geometry.textures.level_sums`) makes the solution
unique and lets corrections fade over some sixty edges; the photos' gains have done the rest.

A surface in pieces is levelled as a whole: every piece adds up what its cells want
(:func:`level_sums`), all are solved together, and every piece takes its part
(:func:`field_of_piece`).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.textures.level_sums import LevelSums, solve_levels
from terraport_pipeline.geometry.textures.seams import Nodes, Seams

__all__ = [
    "LevelField",
    "LevelGrid",
    "field_of_piece",
    "level_field",
    "level_sums",
    "node_levels",
]

_CELL_EDGES: Final = 8.0
"""Side of a cell in mean edges."""

_MAX_SIDE: Final = 2**14 - 2
"""Cells along one axis at most: three axes and a view fit a 64-bit key."""

_STIFFNESS: Final = 0.25
"""Weight of the difference between two cells, per edge of a face that runs from one to the other.
Across a boundary of eight edges run 32 (each counts for both its faces, and a diagonal beside it):
8, which is 1 / lambda = 8 for a field that changes evenly over the eight edges between the centres
(Waechter's is 10)."""

_ALL: Final = slice(None)


@dataclass(frozen=True, slots=True, eq=False)
class LevelGrid:
    """Where the cells lie: one grid for all pieces of a surface that are levelled together."""

    origin: Float64
    """(3,) corner of the cell (0, 0, 0); nothing lies below it."""
    size_m: float
    """Side of a cell."""

    @classmethod
    def over(cls, low: Float64, extent_m: float, edge_m: float) -> LevelGrid:
        """Choose the cells for a surface with such a lowest corner, widest side and mean edge."""
        return cls(low, max(_CELL_EDGES * edge_m, extent_m / _MAX_SIDE, 1e-9))


@dataclass(frozen=True, slots=True, eq=False)
class LevelField:
    """A correction for every cell; C cells here, of C' that were solved."""

    level: Float64
    """(C', 3) sRGB levels."""
    near: Int32
    """(C, 27) rows of `level` of the cells of the same view around every cell (itself at 13), -1
    where there are none."""
    grid: LevelGrid


def level_field(vertices: Float32, nodes: Nodes, seams: Seams) -> tuple[LevelField, Int32]:
    """Solve for the corrections of a whole surface.

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
    low = vertices.min(axis=0).astype(np.float64) if len(vertices) else np.zeros(3)
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    grid = LevelGrid.over(low, extent, _mean_edge(vertices, nodes.corner, nodes.vertex))
    sums, cell = level_sums(vertices, nodes, seams, grid)
    level, _ = solve_levels(sums)
    return LevelField(level, _near_cells(sums.keys, sums.keys), grid), cell


def level_sums(
    vertices: Float32,
    nodes: Nodes,
    seams: Seams,
    grid: LevelGrid,
    *,
    own: slice = _ALL,
    share: Float64 | None = None,
) -> tuple[LevelSums, Int32]:
    """Add up what the cells want of each other.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
    nodes : Nodes
    seams : Seams
    grid : LevelGrid
    own : slice
        Faces that count, with their edges and corners. Before and behind the own faces of a piece
        of a surface stand those around them.
    share : ndarray of shape (S,), float64, optional
        Factor on the weight of every seam: a half where the piece beyond adds it too.

    Returns
    -------
    sums : LevelSums
    cell : ndarray of shape (N,), int32
        Cell of every node.
    """
    key_of_node = _cell_keys(vertices, nodes.vertex, nodes.view, grid.origin, grid.size_m)
    keys, inverse = np.unique(key_of_node, return_inverse=True)
    cell = inverse.astype(np.int32)
    corner = nodes.corner[own]
    link = _crossing_edges(corner, cell)
    weight = np.repeat(0.5 * seams.weight.astype(np.float64) * seams.trust, 2)
    if share is not None:
        weight *= np.repeat(share, 2)
    pull = weight[:, None] * np.repeat(seams.step.astype(np.float64), 2, axis=0)
    return LevelSums(
        keys,
        np.bincount(cell[np.unique(corner)], minlength=len(keys)).astype(np.int64),
        link,
        np.full(len(link), _STIFFNESS),
        cell[seams.node].reshape(-1, 2),
        weight,
        pull,
    ), cell


def field_of_piece(
    vertices: Float32, nodes: Nodes, grid: LevelGrid, keys: Int64, level: Float64
) -> tuple[LevelField, Int32]:
    """Take the corrections of all cells for a piece of the surface.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Of the piece, with those of others around it.
    nodes : Nodes
        Of the same.
    grid : LevelGrid
    keys : ndarray of shape (C',), int64
    level : ndarray of shape (C', 3), float64
        From :func:`solve_levels`, of all cells.

    Returns
    -------
    field : LevelField
    cell : ndarray of shape (N,), int32
        Cell of every node. A cell that was not solved has no correction.
    """
    key_of_node = _cell_keys(vertices, nodes.vertex, nodes.view, grid.origin, grid.size_m)
    here, inverse = np.unique(key_of_node, return_inverse=True)
    return LevelField(level, _near_cells(here, keys), grid), inverse.astype(np.int32)


def node_levels(
    field: LevelField, vertices: Float32, nodes: Nodes, cell: Int32, *, threads: int = 1
) -> Float32:
    """Interpolate the field at every node, (N, 3) float32: trilinear over its view's own cells."""
    levels = np.empty((len(nodes.vertex), 3), np.float32)
    grid = field.grid
    in_chunks(
        lambda begin, end: _interpolate(
            field.level, field.near, grid.origin, grid.size_m, vertices, nodes.vertex, cell,
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
) -> Int64:
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
    crossings = np.empty((count, 2), np.int32)
    n = 0
    for f in range(len(corner)):
        for c in range(3):
            a, b = cell[corner[f, c]], cell[corner[f, (c + 1) % 3]]
            if a != b:
                crossings[n, 0], crossings[n, 1] = a, b
                n += 1
    return crossings


@numba.njit(cache=True, nogil=True)
def _near_cells(here: Int64, keys: Int64) -> Int32:
    """Rows in `keys` of the 27 cells around every cell `here`."""
    near = np.empty((len(here), 27), np.int32)
    for c in range(len(here)):
        for n in range(27):
            dx, dy, dz = n // 9 - 1, (n // 3) % 3 - 1, n % 3 - 1
            wanted = here[c] + ((((dx << 14) + dy) << 14) + dz) * 65536
            at = np.searchsorted(keys, wanted)
            near[c, n] = at if at < len(keys) and keys[at] == wanted else -1
    return near


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
    """Interpolate the field at nodes begin..end, into `levels`.

    Parameters
    ----------
    level : ndarray of shape (C', 3), float64
        Correction of every solved cell.
    near : ndarray of shape (C, 27), int32
        Cells of the same view around every cell, -1 none.
    origin, size : ndarray of shape (3,), float
        The grid, metres.
    vertices, vertex : ndarray of shape (V, 3), (N,)
        Positions, and the vertex of every node.
    cell : ndarray of shape (N,), int32
        Cell of every node.
    levels : ndarray of shape (N, 3), float32
        Written.
    begin, end : int
        Nodes.
    """
    fraction = np.empty(3)
    side = np.empty(3, np.int64)
    for n in range(begin, end):
        # (1) Where the vertex lies between the centres of eight cells: its own and those on the
        # side it leans to.
        for k in range(3):
            coordinate = (vertices[vertex[n], k] - origin[k]) / size
            inside = coordinate - np.floor(coordinate) - 0.5
            side[k] = 1 if inside >= 0.0 else -1
            fraction[k] = abs(inside)
        # (2) Trilinear weights over those of the eight that the view has; (1, 1, 1) of the 3 x 3
        # x 3 neighbours, number 13, is the cell itself. Invariant: `mass` is the sum of the
        # weights used, so that missing neighbours do not pull towards zero.
        mass = 0.0
        total0, total1, total2 = 0.0, 0.0, 0.0
        for corner in range(8):
            weight = 1.0
            at = 13
            stride = 9
            for k in range(3):
                if (corner >> k) & 1:
                    weight *= fraction[k]
                    at += stride * side[k]
                else:
                    weight *= 1.0 - fraction[k]
                stride //= 3
            other = near[cell[n], at]
            if other < 0 or weight == 0.0:
                continue
            mass += weight
            total0 += weight * level[other, 0]
            total1 += weight * level[other, 1]
            total2 += weight * level[other, 2]
        if mass == 0.0:
            mass = 1.0  # a cell that was not solved
        levels[n, 0], levels[n, 1], levels[n, 2] = total0 / mass, total1 / mass, total2 / mass
