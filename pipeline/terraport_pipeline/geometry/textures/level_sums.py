"""The unknowns of global levelling and their equations: added up, joined, solved.

What they are: :mod:`terraport_pipeline.geometry.textures.seam_levels`. One cell takes about 150
bytes with its links, one in about 64 vertices is a cell: a surface of 100 M faces needs 120 MB.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from scipy import sparse

from terraport_payload.types import Float64, Int32, Int64

__all__ = ["LevelSums", "joined_sums", "shorter_sums", "solve_levels"]

_PULL: Final = 2e-3
"""Weight of a node's own correction: it fades to 1 / e over sqrt(8 / 2e-3) = 63 edges. With 2e-4
rendered photos came out 0.4 dB worse in the median than with gains alone."""

_TOLERANCE: Final = 1e-4
_MAX_STEPS: Final = 500
"""Conjugate gradients stop at this part of the right side, or here; usual are 50 to 100."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelSums:
    """What C cells want of each other: of a whole surface, or of a piece of one."""

    keys: Int64
    """(C,) place and view of every cell, ascending."""
    nodes: Int64
    """(C,) nodes in every cell."""
    link: Int32
    """(L, 2) cells that edges of the mesh run between."""
    link_weight: Float64
    """(L,)"""
    seam: Int32
    """(S, 2) cells that meet at a seam."""
    seam_weight: Float64
    """(S,)"""
    seam_pull: Float64
    """(S, 3) weight times step, levels."""


def shorter_sums(sums: LevelSums) -> LevelSums:
    """Add up rows of the same two cells, and leave out cells that nothing is said of."""
    link, link_weight = _added(sums.link, sums.link_weight[:, None], len(sums.keys))
    both = np.concatenate([sums.seam_weight[:, None], sums.seam_pull], axis=1)
    seam, seam_values = _added(sums.seam, both, len(sums.keys))
    used = sums.nodes > 0
    used[link.ravel()] = True
    used[seam.ravel()] = True
    number = (np.cumsum(used) - 1).astype(np.int32)
    return LevelSums(
        sums.keys[used],
        sums.nodes[used],
        number[link],
        link_weight[:, 0],
        number[seam],
        np.ascontiguousarray(seam_values[:, 0]),
        np.ascontiguousarray(seam_values[:, 1:]),
    )


def joined_sums(pieces: Sequence[LevelSums]) -> LevelSums:
    """Put the sums of pieces of one surface together; cells of one key become one."""
    keys = np.unique(np.concatenate([np.zeros(0, np.int64), *(piece.keys for piece in pieces)]))
    cells_of_pieces = [np.searchsorted(keys, piece.keys).astype(np.int32) for piece in pieces]
    nodes = np.zeros(len(keys), np.int64)
    for cells, piece in zip(cells_of_pieces, pieces, strict=True):
        nodes[cells] += piece.nodes
    none = np.zeros((0, 2), np.int32)
    numbered = list(zip(cells_of_pieces, pieces, strict=True))
    return LevelSums(
        keys,
        nodes,
        np.concatenate([none, *(cells[piece.link] for cells, piece in numbered)]),
        np.concatenate([np.zeros(0), *(piece.link_weight for piece in pieces)]),
        np.concatenate([none, *(cells[piece.seam] for cells, piece in numbered)]),
        np.concatenate([np.zeros(0), *(piece.seam_weight for piece in pieces)]),
        np.concatenate([np.zeros((0, 3)), *(piece.seam_pull for piece in pieces)]),
    )


def solve_levels(sums: LevelSums) -> tuple[Float64, int]:
    """Solve for the correction of every cell.

    Returns
    -------
    level : ndarray of shape (C, 3), float64
        sRGB levels.
    steps : int
        Of conjugate gradients.
    """
    n_cells = len(sums.keys)
    one, two = sums.link[:, 0], sums.link[:, 1]
    first, second = sums.seam[:, 0], sums.seam[:, 1]
    rows = np.concatenate([one, two, first, second])
    columns = np.concatenate([two, one, second, first])
    values = np.concatenate([sums.link_weight] * 2 + [sums.seam_weight] * 2)
    matrix = sparse.coo_array((values, (rows, columns)), shape=(n_cells, n_cells)).tocsr()
    diagonal = np.asarray(matrix.sum(axis=1)).ravel()
    diagonal += _PULL * sums.nodes + 1e-12
    right = np.zeros((n_cells, 3))
    for k in range(3):
        pull = sums.seam_pull[:, k]
        right[:, k] = np.bincount(second, pull, n_cells) - np.bincount(first, pull, n_cells)
    level, steps = _conjugate_gradients(
        diagonal, matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data,
        right, _TOLERANCE, _MAX_STEPS,
    )  # fmt: skip
    return level, int(steps)


def _added(pairs: Int32, values: Float64, n_cells: int) -> tuple[Int32, Float64]:
    """Add up the values of equal pairs; pairs ascending."""
    key = pairs[:, 0].astype(np.int64) * n_cells + pairs[:, 1]
    kept, inverse = np.unique(key, return_inverse=True)
    columns = [np.bincount(inverse, column, len(kept)) for column in values.T]
    cell_pairs = np.stack([kept // max(n_cells, 1), kept % max(n_cells, 1)], axis=1)
    return cell_pairs.astype(np.int32), np.stack(columns, axis=1)


@numba.njit(cache=True, nogil=True)
def _conjugate_gradients(
    diagonal: Float64,
    starts: Int64,
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
        # (1) Start at zero: the residual is the right side, the first direction the residual over
        # the diagonal.
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
        # (2) Steps along conjugate directions. Invariant: residual = right - (diagonal - values)
        # x, and rz is the residual's square in the norm of the preconditioner. Sums run in order
        # of the unknowns: the same on every machine and for every number of threads.
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
