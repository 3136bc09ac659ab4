"""Normals of a cloud: the plane of each point's neighbours, turned out of the ground.

Direction: principal component analysis of each point's k nearest neighbours (the eigenvector of
the smallest eigenvalue). Sign: :mod:`terraport_pipeline.geometry.clouds.signs`.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.clouds.signs import sky_signs, spread_signs
from terraport_pipeline.geometry.clouds.spacing import Neighbours
from terraport_pipeline.geometry.mesh.chunks import in_chunks

__all__ = ["estimate_normals", "orient_normals"]

_SWEEPS = 12
"""Jacobi sweeps at most; three by three matrices converge to float64 in five or six."""

_CHUNK = 2**14
"""Points that a thread fits planes to at once: some 30 ms."""


def estimate_normals(
    points: Float32, neighbours: Neighbours, *, k: int = 16, threads: int = 1
) -> tuple[Float32, Float32]:
    """Estimate the tangent plane at every point.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres.
    neighbours : Neighbours
        Of all points; the first `k` of each are used, with the point itself.
    k : int
    threads : int

    Returns
    -------
    normals : ndarray of shape (N, 3), float32
        Unit, sign arbitrary.
    curvature : ndarray of shape (N,), float32
        Smallest eigenvalue over the sum of the three, 0 (plane) to 1/3 (no surface at all).
    """
    k = min(k, neighbours.indices.shape[1])
    normals = np.empty((len(points), 3), dtype=np.float32)
    curvature = np.empty(len(points), dtype=np.float32)
    indices = np.ascontiguousarray(neighbours.indices[:, :k])
    in_chunks(
        lambda begin, end: _fit_planes(points, indices, normals, curvature, begin, end),
        len(points),
        threads=threads,
        chunk=_CHUNK,
    )
    return normals, curvature


def orient_normals(
    points: Float32,
    normals: Float32,
    neighbours: Neighbours,
    *,
    spacing_m: float,
    k: int = 10,
    grid_origin_m: tuple[float, float] | None = None,
    above: Float32 | None = None,
) -> tuple[Float32, int, int]:
    """Turn normals out of the ground.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres, scene frame (Y up).
    normals : ndarray of shape (N, 3), float32
        Unit, sign arbitrary; not modified.
    neighbours : Neighbours
        Of all points; signs spread over the first `k`.
    spacing_m : float
        Areal spacing.
    k : int
    grid_origin_m : (x, z), optional
    above : ndarray of shape (R, 3), float32, optional
        See :func:`terraport_pipeline.geometry.clouds.signs.sky_signs`.

    Returns
    -------
    normals : ndarray of shape (N, 3), float32
    spread : int
        Points that got their sign from a neighbour.
    guessed : int
        Points that nothing reached; they face up.
    """
    oriented = np.where((normals[:, 1] < 0)[:, None], -normals, normals)
    sky = sky_signs(points, oriented, spacing_m=spacing_m, grid_origin_m=grid_origin_m, above=above)
    graph = np.ascontiguousarray(neighbours.indices[:, : min(k, neighbours.indices.shape[1])])
    reached = spread_signs(points, oriented, sky, graph)
    guessed = int((~reached).sum())
    return oriented, int(len(points) - sky.certain.sum() - guessed), guessed


@numba.njit(cache=True, nogil=True)
def _fit_planes(
    points: Float32, indices: Int32, normals: Float32, curvature: Float32, begin: int, end: int
) -> None:  # pragma: no cover - compiled
    """Covariance of each neighbourhood and its smallest eigenvector by Jacobi rotations."""
    k = indices.shape[1]
    mean, offset = np.empty(3), np.empty(3)
    matrix, vectors = np.empty((3, 3)), np.empty((3, 3))
    for point in range(begin, end):
        # (1) Covariance, up to a factor.
        # Offsets from the point itself: it adds nothing to the sums, only to the count.
        mean[:] = 0.0
        matrix[:] = 0.0
        for rank in range(k):
            for axis in range(3):
                offset[axis] = points[indices[point, rank], axis] - points[point, axis]
                mean[axis] += offset[axis] / (k + 1)
            for row in range(3):
                for col in range(row, 3):
                    matrix[row, col] += offset[row] * offset[col]
        for row in range(3):
            for col in range(row, 3):
                matrix[row, col] -= (k + 1) * mean[row] * mean[col]
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
        # (2) Jacobi rotations until nothing is left beside the diagonal. Invariant: vectors *
        # matrix * vectors^T is the covariance, and the columns of `vectors` are orthonormal.
        for row in range(3):
            for col in range(3):
                vectors[row, col] = 1.0 if row == col else 0.0
        for _ in range(_SWEEPS):
            off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
            scale = matrix[0, 0] ** 2 + matrix[1, 1] ** 2 + matrix[2, 2] ** 2
            if off <= 1e-28 * scale or scale == 0.0:
                break
            for p in range(2):
                for q in range(p + 1, 3):
                    if matrix[p, q] == 0.0:
                        continue
                    theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                    if theta < 0.0:
                        t = -t
                    c = 1.0 / np.sqrt(t * t + 1.0)
                    s = t * c
                    for row in range(3):
                        left, right = matrix[row, p], matrix[row, q]
                        matrix[row, p], matrix[row, q] = c * left - s * right, s * left + c * right
                    for col in range(3):
                        left, right = matrix[p, col], matrix[q, col]
                        matrix[p, col], matrix[q, col] = c * left - s * right, s * left + c * right
                    for row in range(3):
                        left, right = vectors[row, p], vectors[row, q]
                        vectors[row, p], vectors[row, q] = (
                            c * left - s * right,
                            s * left + c * right,
                        )
        # (3) The normal is the vector of the smallest eigenvalue; its share of the sum is the
        # curvature.
        small = 0
        for axis in range(1, 3):
            if matrix[axis, axis] < matrix[small, small]:
                small = axis
        length = np.sqrt(vectors[0, small] ** 2 + vectors[1, small] ** 2 + vectors[2, small] ** 2)
        for axis in range(3):
            normals[point, axis] = vectors[axis, small] / length
        total = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        curvature[point] = max(matrix[small, small], 0.0) / total if total > 0.0 else 0.0
