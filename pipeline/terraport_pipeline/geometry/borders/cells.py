"""Cells of ground: the faces within one cube of a lattice, summed up.

Borders are looked for between cells and not between faces, so that evidence is measured over metres
and not over what a triangle happens to be. A cell is all faces whose middle lies in one cube of a
lattice in the scene's own frame: walls and overhangs have cells of their own, and a cell that two
tiles share is the same cell in both. All sums are whole numbers, so cells of several tiles add up
to those of the whole, bit for bit, however the surface is cut into tiles.

PURE: no I/O, no clock. Linear in the faces but for a sort of their cubes; some 200 bytes per face,
100 per cell and 24 per pair of cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.regions.pool_refine import number_by_first

__all__ = [
    "LAB_STEPS",
    "LENGTH_STEPS",
    "CellGraph",
    "cells_of_faces",
    "joined_cells",
    "length_steps",
    "summed_pairs",
]

LAB_STEPS: Final = 64.0
"""Steps in one unit of CIELAB."""
_AREA_STEPS: Final = 1e6
"""Areas are whole square millimetres: of cells up to 1,000 m2 all sums fit 64 bits."""
LENGTH_STEPS: Final = 2.0**14
"""Lengths are whole steps of 0.06 mm, finer than float32 a kilometre from the origin."""
_SIDE: Final = 2**20
"""Cubes from the origin to each side that a key can tell apart."""


@dataclass(frozen=True, slots=True, eq=False)
class CellGraph:
    """Cells of a surface or of one tile of it, what was summed over them, and who touches whom."""

    labels: Int32
    """(F,) cell of every face, numbered by first face; empty for cells of several tiles."""
    keys: Int64
    """(U,) which cube."""
    sums: Int64
    """(U, 8): area; area times L*, a*, b* and L* squared, in steps; area vector x, y, z."""
    pairs: Int32
    """(E, 2) cells that share edges, lower first."""
    border: Int64
    """(E,) length of what they share, in steps."""

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.keys)

    def middles(self, cell_m: float) -> Float64:
        """Middle of every cell's cube, metres, (U, 3)."""
        x, rest = np.divmod(self.keys, 4 * _SIDE * _SIDE)
        z, y = np.divmod(rest, 2 * _SIDE)
        middles: Float64 = (np.stack([x, y, z], axis=1) - _SIDE + 0.5) * cell_m
        return middles


def length_steps(length_m: AnyFloat) -> Int64:
    """Lengths in whole steps, at least one."""
    steps: Int64 = np.maximum(np.rint(length_m * LENGTH_STEPS), 1.0).astype(np.int64)
    return steps


def cells_of_faces(
    vertices: Float32, faces: Int32, lab: AnyInt, pairs: tuple[Int32, Int32], cell_m: float
) -> CellGraph:
    """Sum up the faces of every cell.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, the scene's frame.
    faces : ndarray of shape (F, 3), int32
    lab : ndarray of shape (F, 3), integer
        CIELAB of every face in steps of 1 / ``LAB_STEPS``.
    pairs : pair of ndarray
        ``face_pairs`` of the mesh.
    cell_m : float
        Side of a cube, metres, > 0.

    Returns
    -------
    CellGraph

    Raises
    ------
    ValueError
        A face farther from the origin than cubes can be numbered.
    """
    # (1) The cube of every face.
    corners = vertices.astype(np.float64)[faces]
    cube = np.floor(corners.mean(axis=1) / cell_m)
    if len(cube) and np.abs(cube).max() >= _SIDE:
        msg = f"cells of {cell_m:g} m reach {_SIDE * cell_m:g} m; a face lies beyond"
        raise ValueError(msg)
    x, y, z = (cube.astype(np.int64) + _SIDE).T
    keys, found = np.unique((x * 2 * _SIDE + z) * 2 * _SIDE + y, return_inverse=True)
    labels, count = number_by_first(found.astype(np.int32))
    numbered = np.empty(count, np.int64)
    numbered[labels] = keys[found]
    # (2) Sums, in whole numbers.
    normal = (
        0.5 * _AREA_STEPS * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    )
    area = np.maximum(np.rint(np.linalg.norm(normal, axis=1)), 1.0)
    columns = [area, *(area * lab.T), area * lab[:, 0].astype(np.float64) ** 2, *np.rint(normal.T)]
    sums = np.zeros((count, len(columns)), np.int64)
    for column, values in enumerate(columns):
        np.add.at(sums[:, column], labels, values.astype(np.int64))
    # (3) Who touches whom, over what length.
    neighbours, edges = pairs
    ends = vertices.astype(np.float64)[edges]
    steps = length_steps(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))
    return CellGraph(labels, numbered, sums, *summed_pairs(labels[neighbours], steps, count))


def joined_cells(
    tiles: Sequence[CellGraph], across: Int32, across_steps: Int64
) -> tuple[CellGraph, list[Int32]]:
    """Add up the cells of all tiles.

    Parameters
    ----------
    tiles : sequence of CellGraph
        At least one; their labels are not looked at.
    across : ndarray of shape (S, 2), int32
        Cells on both sides of every edge between tiles, numbered over all tiles in their order.
    across_steps : ndarray of shape (S,), int64
        Lengths of these edges.

    Returns
    -------
    graph : CellGraph
        In order of the keys.
    cells : list of ndarray
        For every tile the number there of each of its cells.
    """
    keys, found = np.unique(np.concatenate([tile.keys for tile in tiles]), return_inverse=True)
    sums = np.zeros((len(keys), tiles[0].sums.shape[1]), np.int64)
    np.add.at(sums, found, np.concatenate([tile.sums for tile in tiles]))
    starts = np.concatenate([[0], np.cumsum([tile.count for tile in tiles])])
    pairs = [found[tile.pairs + at] for tile, at in zip(tiles, starts[:-1], strict=True)]
    pairs.append(found[across])
    border = np.concatenate([*(tile.border for tile in tiles), across_steps])
    graph = CellGraph(
        np.zeros(0, np.int32), keys, sums,
        *summed_pairs(np.concatenate(pairs), border, len(keys)),
    )  # fmt: skip
    return graph, np.split(found.astype(np.int32), starts[1:-1])


def summed_pairs(pairs: AnyInt, steps: Int64, count: int) -> tuple[Int32, Int64]:
    """Sort pairs of cells, leave out those of one cell, add up the lengths of equal ones."""
    low, high = np.sort(pairs, axis=1).T.astype(np.int64)
    apart = low != high
    key, row = np.unique(low[apart] * count + high[apart], return_inverse=True)
    border = np.zeros(len(key), np.int64)
    np.add.at(border, row, steps[apart])
    return np.stack(np.divmod(key, max(count, 1)), axis=1).astype(np.int32), border
