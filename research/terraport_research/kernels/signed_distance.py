"""Signed distance to the surface that oriented samples lie on, in a band of cells around them.

Each node takes the mean of its nearest samples' tangent planes, near ones weighing more: the
distance of H. Hoppe, T. DeRose, T. Duchamp, J. McDonald and W. Stuetzle, "Surface reconstruction
from unorganized points", SIGGRAPH 1992, smoothed as R. Kolluri, "Provably good moving least
squares", SODA 2005, does.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_research.kernels.marching_cubes import CORNERS, march

__all__ = ["march_samples"]


_CHUNK = 100_000
"""Nodes per neighbour query; bounds its scratch to about 100 MB."""

_BAND_CELLS = 2
"""Cells around a sample's cell that are looked at: the surface runs within the first."""


def march_samples(
    points: Float32,
    normals: Float32,
    *,
    cell_m: float,
    reach_m: float,
    neighbours: int = 12,
    workers: int = 1,
) -> tuple[Float32, Int32]:
    """Reconstruct a surface by marching cubes.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres.
    normals : ndarray of shape (N, 3), float32
        Unit, out of the surface.
    cell_m : float
        Side of a cell; about the spacing of the samples.
    reach_m : float
        Nodes whose foot on the tangent planes lies farther than this from the nearest sample are
        not known: the surface ends there.
    neighbours : int
        Samples whose planes are averaged. More smooths.
    workers : int
        Threads of the neighbour search; the result does not depend on it.

    Returns
    -------
    vertices : ndarray of shape (V, 3), float32
        Metres, float32.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside.
    """
    low = points.min(axis=0).astype(np.float64) - (_BAND_CELLS + 1) * cell_m
    cells, shape = _band(((points - low) / cell_m).astype(np.int64))
    strides = np.array([shape[1] * shape[2], shape[2], 1], np.int64)
    keys = np.unique((cells @ strides)[:, None] + CORNERS @ strides)
    x, rest = np.divmod(keys, strides[0])
    nodes = np.stack([x, *np.divmod(rest, shape[2])], axis=1) * cell_m + low
    values = np.empty(len(nodes))
    tree = cKDTree(points, balanced_tree=False)
    k = min(neighbours, len(points))
    for begin in range(0, len(nodes), _CHUNK):
        here = slice(begin, begin + _CHUNK)
        away, near = tree.query(nodes[here], k=[*range(1, k + 1)], workers=workers)
        values[here] = _mean_plane(nodes[here], points, normals, away, near, cell_m, reach_m)
    vertices, faces = march(cells, values, keys, shape)
    return (vertices * cell_m + low).astype(np.float32), faces


def _mean_plane(
    nodes: Float64,
    points: Float32,
    normals: Float32,
    away: Float64,
    near: Int64,
    cell_m: float,
    reach_m: float,
) -> Float64:
    """Weighted mean distance to the planes of the nearest samples; NaN beyond their reach."""
    offset = nodes[:, None] - points[near]
    height = np.einsum("mkc,mkc->mk", offset, normals[near].astype(np.float64))
    # Relative to the nearest, so that far from all samples no weight becomes 0 / 0.
    weight = np.exp(-(away**2 - away[:, :1] ** 2) / (1.5 * cell_m) ** 2)
    mean: Float64 = (weight * height).sum(axis=1) / weight.sum(axis=1)
    # From the node's foot on the surface to the nearest sample, along the surface.
    along = np.sqrt(np.maximum(away[:, 0] ** 2 - mean**2, 0.0))
    mean[along > reach_m] = np.nan
    return mean


def _band(cells: Int64) -> tuple[Int64, tuple[int, int, int]]:
    """Cells within the band of some cells, each once, and the number of nodes of their grid."""
    size = cells.max(axis=0) + _BAND_CELLS + 3
    shape = (int(size[0]), int(size[1]), int(size[2]))
    strides = np.array([shape[1] * shape[2], shape[2], 1], np.int64)
    keys = np.unique(cells @ strides)
    for axis in range(3):
        steps = np.arange(-_BAND_CELLS, _BAND_CELLS + 1) * strides[axis]
        keys = np.unique(keys[:, None] + steps)
    x, rest = np.divmod(keys, strides[0])
    return np.stack([x, *np.divmod(rest, shape[2])], axis=1), shape
