"""Noisy samples moved onto the surface that their neighbours show, edges kept.

1. A plane is fitted to each sample's neighbourhood; its normal is the first guess.
2. Normals are averaged over the neighbourhood, each by how like the sample's own it is: across an
edge they differ and do not count. Twice.
3. A quadric is fitted over the tangent plane, with the same weights; the sample moves along its
normal onto it, and takes the quadric's normal there.

Weights fall to 0 at `radius_m`, so a sample depends on nothing farther away than
:data:`REACH_RADII` of these: two tiles that both see so much move it alike.

References
----------
M. Alexa et al., "Computing and rendering point set surfaces", IEEE TVCG 9(1), 2003: samples moved
onto a local polynomial over a local plane (moving least squares).
T. Jones, F. Durand and M. Zwicker, "Normal improvement for point rendering", IEEE CG&A 24(4), 2004,
and A. C. Oeztireli, G. Guennebaud and M. Gross, "Feature preserving point set surfaces based on
non-linear kernel regression", Computer Graphics Forum 28(2), 2009: weights by the difference of
normals. Unlike there, one pass, so that the reach stays small.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Float32, Float64, Int64

__all__ = ["REACH_RADII", "smooth_samples"]

REACH_RADII: Final = 4
"""A plane, two averages and the quadric look one radius far each."""

_ALIKE: Final = (1.2, 0.6)
"""Chord at which another normal counts 1/e, of the first average and the second: wide first, or a
first guess that is far off finds none like itself and stays (74, then 35 degrees)."""

_FIT_ALIKE: Final = _ALIKE[-1]


def smooth_samples(points: AnyFloat, *, radius_m: float, most_m: float) -> tuple[Float32, Float32]:
    """Move samples onto their surface.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        Metres.
    radius_m : float
        Of the neighbourhoods; several spacings and several deviations of the noise.
    most_m : float
        A sample that lies farther from its fit is no noise and stays.

    Returns
    -------
    points : ndarray of shape (N, 3), float32
        In the order given.
    normals : ndarray of shape (N, 3), float32
        Unit, sign arbitrary.

    Notes
    -----
    Threads of numba; the answer does not depend on their number. 190 bytes per sample.
    """
    # (1) Samples sorted by cubes of one radius: neighbours lie in three by three columns of three
    # cubes, and the cubes of a column follow each other.
    where = np.asarray(points, dtype=np.float64)
    cube = np.floor((where - where.min(axis=0)) / radius_m).astype(np.int64) + 1
    size = cube.max(axis=0) + 2
    key = (cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2]
    order = np.argsort(key, kind="stable")
    keys, starts = np.unique(key[order], return_index=True)
    starts = np.append(starts, len(key))
    columns = _columns(keys, starts, size)
    cube_of = np.searchsorted(keys, key[order])
    where = np.ascontiguousarray(where[order])
    # (2) Normals: planes, then averages of like ones.
    normals = np.empty_like(where)
    other = np.empty_like(where)
    _fit_planes(where, cube_of, columns, radius_m, normals)
    for alike in _ALIKE:
        _average_normals(where, normals, cube_of, columns, radius_m, alike, other)
        normals, other = other, normals
    # (3) Onto the quadric.
    moved, turned = np.empty_like(where), other
    _fit_quadrics(where, normals, cube_of, columns, radius_m, most_m, moved, turned)
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    return moved[back].astype(np.float32), turned[back].astype(np.float32)


def _columns(keys: Int64, starts: Int64, size: Int64) -> Int64:
    """First row and row after the last of the nine columns round every cube, (C, 9, 2)."""
    columns = np.empty((len(keys), 9, 2), dtype=np.int64)
    for column in range(9):
        step = ((column // 3 - 1) * size[1] + column % 3 - 1) * size[2]
        columns[:, column, 0] = starts[np.searchsorted(keys, keys + step - 1)]
        columns[:, column, 1] = starts[np.searchsorted(keys, keys + step + 1, side="right")]
    return columns


@numba.njit(parallel=True, cache=True)
def _fit_planes(
    points: Float64, cube_of: Int64, columns: Int64, radius_m: float, normals: Float64
) -> None:  # pragma: no cover - compiled
    """Fit a weighted plane round every sample; its normal goes into `normals`."""
    for point in numba.prange(len(points)):
        cube = cube_of[point]
        total = 0.0
        mean = np.zeros(3)
        matrix = np.zeros((3, 3))
        offset = np.empty(3)
        for column in range(9):
            for near in range(columns[cube, column, 0], columns[cube, column, 1]):
                square = 0.0
                for axis in range(3):
                    offset[axis] = (points[near, axis] - points[point, axis]) / radius_m
                    square += offset[axis] * offset[axis]
                if square >= 1.0:
                    continue
                weight = (1.0 - square) * (1.0 - square)
                total += weight
                for row in range(3):
                    mean[row] += weight * offset[row]
                    for col in range(row, 3):
                        matrix[row, col] += weight * offset[row] * offset[col]
        for row in range(3):
            for col in range(row, 3):
                matrix[row, col] = matrix[row, col] / total - mean[row] * mean[col] / total**2
                matrix[col, row] = matrix[row, col]
        _, vectors = np.linalg.eigh(matrix)  # ascending
        for axis in range(3):
            normals[point, axis] = vectors[axis, 0]


@numba.njit(parallel=True, cache=True)
def _average_normals(
    points: Float64,
    normals: Float64,
    cube_of: Int64,
    columns: Int64,
    radius_m: float,
    alike: float,
    averaged: Float64,
) -> None:  # pragma: no cover - compiled
    """Average the normals like a sample's own, whatever their signs, into `averaged`."""
    for point in numba.prange(len(points)):
        cube = cube_of[point]
        total = np.zeros(3)
        for column in range(9):
            for near in range(columns[cube, column, 0], columns[cube, column, 1]):
                square = 0.0
                dot = 0.0
                for axis in range(3):
                    offset = (points[near, axis] - points[point, axis]) / radius_m
                    square += offset * offset
                    dot += normals[near, axis] * normals[point, axis]
                if square >= 1.0:
                    continue
                weight = (1.0 - square) * (1.0 - square)
                weight *= np.exp(-(2.0 - 2.0 * abs(dot)) / (alike * alike))
                if dot < 0.0:
                    weight = -weight
                for axis in range(3):
                    total[axis] += weight * normals[near, axis]
        length = np.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
        for axis in range(3):
            averaged[point, axis] = total[axis] / length


@numba.njit(parallel=True, cache=True)
def _fit_quadrics(
    points: Float64,
    normals: Float64,
    cube_of: Int64,
    columns: Int64,
    radius_m: float,
    most_m: float,
    moved: Float64,
    turned: Float64,
) -> None:  # pragma: no cover - compiled
    """Move every sample onto the quadric over its tangent plane; into `moved` and `turned`."""
    for point in numba.prange(len(points)):
        cube = cube_of[point]
        # (1) The tangent plane's axes: the coordinate axis least like the normal, made square.
        normal = normals[point]
        flat = 0
        for axis in range(1, 3):
            if abs(normal[axis]) < abs(normal[flat]):
                flat = axis
        first, second = np.empty(3), np.empty(3)
        for axis in range(3):
            first[axis] = -normal[flat] * normal[axis]
        first[flat] += 1.0
        first /= np.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2)
        for axis in range(3):
            after, last = (axis + 1) % 3, (axis + 2) % 3
            second[axis] = normal[after] * first[last] - normal[last] * first[after]
        # (2) Weighted normal equations of 1, a, b, a^2, ab, b^2; lengths in radii.
        matrix, right, term = np.zeros((6, 6)), np.zeros(6), np.ones(6)
        for column in range(9):
            for near in range(columns[cube, column, 0], columns[cube, column, 1]):
                square, a, b, height, dot = 0.0, 0.0, 0.0, 0.0, 0.0
                for axis in range(3):
                    offset = (points[near, axis] - points[point, axis]) / radius_m
                    square += offset * offset
                    a += offset * first[axis]
                    b += offset * second[axis]
                    height += offset * normal[axis]
                    dot += normals[near, axis] * normal[axis]
                if square >= 1.0:
                    continue
                weight = (1.0 - square) * (1.0 - square)
                weight *= np.exp(-(2.0 - 2.0 * abs(dot)) / (_FIT_ALIKE * _FIT_ALIKE))
                term[1], term[2], term[3], term[4], term[5] = a, b, a * a, a * b, b * b
                for row in range(6):
                    for col in range(row, 6):
                        matrix[row, col] += weight * term[row] * term[col]
                    right[row] += weight * term[row] * height
        # (3) Solved with some damping: too few samples give a plane, or no move at all, and
        # rounding is not amplified.
        damping = 1e-4 * matrix[0, 0]
        for row in range(6):
            for col in range(row):
                matrix[row, col] = matrix[col, row]
            matrix[row, row] += damping
        fitted = np.linalg.solve(matrix, right)
        shift_m = fitted[0] * radius_m
        if not abs(shift_m) <= most_m:
            shift_m, fitted[1], fitted[2] = 0.0, 0.0, 0.0
        length = np.sqrt(1.0 + fitted[1] ** 2 + fitted[2] ** 2)
        for axis in range(3):
            slope = fitted[1] * first[axis] + fitted[2] * second[axis]
            moved[point, axis] = points[point, axis] + shift_m * normal[axis]
            turned[point, axis] = (normal[axis] - slope) / length
