"""How far planes, spheres and cylinders are from parts of a surface, by the parts' moments alone.

A part is 35 sums over its surface, of all products of up to four coordinates, and six of its
normals' products. Sums of two parts are those of both together, so the error of a fit to a union
costs the same whatever is in it. Fits of spheres and cylinders are algebraic: the sum of squares of
x^2 - 2 c x - g is least, and is over 4 r^2 (to first order the distance).

PURE: no I/O, no clock.

References
----------
M. Attene, B. Falcidieno, M. Spagnuolo, "Hierarchical mesh segmentation based on fitting
primitives", The Visual Computer 22(3), 2006, section 4.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64, Int64

__all__ = ["fit_error", "part_sums"]

_POWERS: Final = np.array(
    [
        (i, j, total - i - j)
        for total in range(5)
        for i in range(total, -1, -1)
        for j in range(total - i, -1, -1)
    ],
    np.int64,
)
"""(35, 3) powers of x, y and z in each of a part's sums: 1, x, y, z, xx, xy, xz, yy, ..."""
_NORMALS: Final = len(_POWERS)
"""Where sums of nx nx, nx ny, nx nz, ny ny, ny nz, nz nz begin, after those."""

_PLACE: Final = np.full((5, 5, 5), -1, np.int64)
"""Where a product stands in the sums."""
for _at, (_i, _j, _k) in enumerate(_POWERS):
    _PLACE[_i, _j, _k] = _at
_SECOND: Final = np.empty((3, 3), np.int64)
_THIRD: Final = np.empty((3, 3, 3), np.int64)
_FOURTH: Final = np.empty((3, 3, 3, 3), np.int64)
"""The same for a product of coordinates by their numbers."""
for _table in (_SECOND, _THIRD, _FOURTH):
    for _key in np.ndindex(_table.shape):
        _table[_key] = _PLACE[tuple(np.bincount(_key, minlength=3))]
_BINOMIAL: Final = np.array(
    [[1, 0, 0, 0, 0], [1, 1, 0, 0, 0], [1, 2, 1, 0, 0], [1, 3, 3, 1, 0], [1, 4, 6, 4, 1]],
    np.float64,
)


def _shifts() -> tuple[Int64, Float64]:
    """Terms of (x - c)^i (y - d)^j (z - e)^k: target, source, powers of c, d, e; and factors."""
    rows, factors = [], []
    for target, (i, j, k) in enumerate(_POWERS):
        for a in range(i + 1):
            for b in range(j + 1):
                for c in range(k + 1):
                    rows.append((target, _PLACE[a, b, c], i - a, j - b, k - c))
                    factors.append(
                        _BINOMIAL[i, a] * _BINOMIAL[j, b] * _BINOMIAL[k, c]
                        * (-1.0) ** (i - a + j - b + k - c)
                    )  # fmt: skip
    return np.array(rows, np.int64), np.array(factors)


_TERMS, _FACTORS = _shifts()
_FLAT: Final = 1e-9
"""A part that is this share as deep as it is wide (in squares) is flat, and no sphere or
cylinder."""
_SWEEPS: Final = 12
"""Of Jacobi's rotations, at most: five are usual."""


def part_sums(corners: Float64, area: Float64, normals: Float64) -> Float64:
    """Sum over single triangles, each as a third of its area in the middle of every edge.

    Parameters
    ----------
    corners : ndarray of shape (F, 3, 3), float64
    area : ndarray of shape (F,), float64
    normals : ndarray of shape (F, 3), float64
        Unit.

    Returns
    -------
    ndarray of shape (F, 41), float64
    """
    middles = (corners + np.roll(corners, 1, axis=1)) / 2  # exact for planes
    powers = middles[:, :, :, None] ** np.arange(5.0)
    products = (
        powers[:, :, 0, _POWERS[:, 0]]
        * powers[:, :, 1, _POWERS[:, 1]]
        * powers[:, :, 2, _POWERS[:, 2]]
    )
    first, second = np.triu_indices(3)
    crossed = normals[:, first] * normals[:, second]
    return np.concatenate([products.mean(axis=1), crossed], axis=1) * area[:, None]


@numba.njit(cache=True)
def fit_error(sums: Float64) -> float:
    """Find the least of the three primitives' errors.

    Parameters
    ----------
    sums : ndarray of shape (41,), float64
        As of :func:`part_sums`, of one part.

    Returns
    -------
    float
        Square of the distance to the primitive, over the area: length^4.
    """
    if sums[0] <= 0.0:
        return 0.0
    moments = _about_centre(sums)
    shape = np.empty((3, 3))
    facing = np.empty((3, 3))
    place = 0
    for i in range(3):
        for j in range(i, 3):
            shape[i, j] = shape[j, i] = moments[_SECOND[i, j]]
            facing[i, j] = facing[j, i] = sums[_NORMALS + place]
            place += 1
    frame = np.eye(3)
    sphere = _round_error(moments, frame, 3)
    plane = _diagonal(shape, frame)[0]
    turned = np.eye(3)
    _diagonal(facing, turned)
    # A cylinder's normals lie across its axis: the direction that they have least of comes first.
    cylinder = _round_error(moments, turned[1:], 2)
    return float(max(min(plane, sphere, cylinder), 0.0))


@numba.njit(cache=True)
def _about_centre(sums: Float64) -> Float64:
    moments = np.zeros(_NORMALS)
    powers = np.ones((3, 5))
    for axis in range(3):
        for power in range(1, 5):
            powers[axis, power] = powers[axis, power - 1] * sums[1 + axis] / sums[0]
    for term in range(len(_FACTORS)):
        target, source, i, j, k = _TERMS[term]
        moments[target] += (
            _FACTORS[term] * sums[source] * powers[0, i] * powers[1, j] * powers[2, k]
        )
    return moments


@numba.njit(cache=True)
def _round_error(moments: Float64, basis: Float64, n: int) -> float:
    """Error of a sphere (n = 3) or of a circle across an axis (2); infinite where it is flat.

    ``basis`` (n, 3) spans what is projected to. With y the place there about the centre and s =
    y y, least squares of s - 2 c y - g: y has mean 0, so that g is the mean of s, and
    2 (sum y y') c = sum s y.
    """
    across = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for a in range(n):
                across[i, j] += basis[a, i] * basis[a, j]
    square, second, third = 0.0, 0.0, np.zeros(3)
    for i in range(3):
        for j in range(3):
            share = across[i, j]
            if share == 0.0:
                continue
            second += share * moments[_SECOND[i, j]]
            for k in range(3):
                third[k] += share * moments[_THIRD[i, j, k]]
                for m in range(3):
                    square += share * across[k, m] * moments[_FOURTH[i, j, k, m]]
    # The system with its right side in the last column, solved by elimination: positive, no pivots.
    system = np.zeros((3, 4))
    for a in range(n):
        for i in range(3):
            system[a, 3] += basis[a, i] * third[i]
            for j in range(3):
                for b in range(n):
                    system[a, b] += basis[a, i] * basis[b, j] * moments[_SECOND[i, j]]
    gain, lengths = 0.0, 0.0
    pull = system[:, 3].copy()
    for a in range(n):
        if not system[a, a] > _FLAT * second:
            return np.inf
        for b in range(a + 1, n):
            share = system[b, a] / system[a, a]
            for c in range(a, 4):
                system[b, c] -= share * system[a, c]
    centre = np.zeros(3)
    for a in range(n - 1, -1, -1):
        rest = system[a, 3]
        for b in range(a + 1, n):
            rest -= system[a, b] * centre[b]
        centre[a] = rest / system[a, a]
    for a in range(n):
        gain += centre[a] * pull[a]
        lengths += centre[a] * centre[a]
    radius2 = second / moments[0] + lengths / 4  # the centre lies at half of what was solved for
    return float(max(square - second * second / moments[0] - gain, 0.0) / (4.0 * radius2))


@numba.njit(cache=True)
def _diagonal(matrix: Float64, frame: Float64) -> Float64:
    """Turn a symmetric matrix (3, 3) to its axes by Jacobi's rotations, ascending.

    Both are changed; the rows of ``frame`` become the axes.
    """
    for _ in range(_SWEEPS):
        off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
        if off <= 1e-30 * (matrix[0, 0] ** 2 + matrix[1, 1] ** 2 + matrix[2, 2] ** 2):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0.0:
                    continue
                half = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                tangent = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(half * half + 1.0))
                cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = cosine * a - sine * b, sine * a + cosine * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = cosine * a - sine * b, sine * a + cosine * b
                    a, b = frame[p, k], frame[q, k]
                    frame[p, k], frame[q, k] = cosine * a - sine * b, sine * a + cosine * b
    values = np.array([matrix[0, 0], matrix[1, 1], matrix[2, 2]])
    for last in (2, 1):
        for i in range(last):
            if values[i] > values[i + 1]:
                values[i], values[i + 1] = values[i + 1], values[i]
                for k in range(3):
                    frame[i, k], frame[i + 1, k] = frame[i + 1, k], frame[i, k]
    return values
