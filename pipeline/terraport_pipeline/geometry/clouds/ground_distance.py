"""How far apart two surveys of one ground lie, cube by cube, and how sure that is.

After M3C2: a distance along the surface's normal between the mean positions of both surveys'
samples in a cylinder along it, with an error from how far the samples scatter. Three departures
make it work on sums alone (:mod:`.ground_cells`), at a fixed cost per cube:

* The cylinder is a column of three cubes along the axis that the surface faces most. That axis
  follows from the samples of the 27 cubes around, and has the largest minor of their covariance:
  the widest projection.
* Instead of a normal fixed beforehand, a plane is fitted in the column, the same slope for both
  surveys and a height for each (analysis of covariance); so samples that lie elsewhere along the
  slope do not count as a distance.
* Scatter within each survey only goes into the slope: two layers of ground have the slope of
  each, not that of the step between them.

References
----------
D. Lague, N. Brodu and J. Leroux, "Accurate 3D comparison of complex topography with terrestrial
laser scanner", ISPRS Journal of Photogrammetry and Remote Sensing 82, 2013,
doi:10.1016/j.isprsjprs.2013.04.009.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int8, Int32, Int64, UInt8, UInt64
from terraport_pipeline.geometry.clouds.ground_cells import (
    COUNT,
    KEY_BITS,
    MEAN,
    PRODUCT,
    TICKS,
    GroundSums,
)
from terraport_pipeline.geometry.mesh.chunks import in_chunks

__all__ = ["LEAST", "GroundDistance", "fit_planes", "measure_ground"]

LEAST: Final = 8
"""Samples of each survey below which no distance is measured: the fit has four terms."""

_RIDGE: Final = 64.0
"""Ticks squared, added to the variance along the surface: samples in a row have no slope across
it. A hundredth of what samples all over a cube have."""

_REACH_VOXELS: Final = 4
"""Voxels that are looked at around each, at most: one cube."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundDistance:
    """Per cube; distances in widths of a cube, along the normal."""

    distance: Float32
    """(K,) the second survey's ground beyond the first's, along the axis it faces (up, east, south
    count as positive); NaN where one has fewer than :data:`LEAST` samples."""
    error: Float32
    """(K,) standard deviation of that distance."""
    scatter: Float32
    """(K,) standard deviation of the samples about their plane: noise and what is not plane."""
    lost: UInt8
    """(K,) voxels with samples of the first survey that are out of reach of the second's."""
    gained: UInt8
    """(K,) and of the second out of reach of the first's."""


def measure_ground(
    keys: Int64,
    before: GroundSums,
    after: GroundSums,
    *,
    reach: float,
    threads: int = 1,
) -> GroundDistance:
    """Measure distances between two surveys.

    Parameters
    ----------
    keys : ndarray of shape (K,), int64
        Of the cubes that hold samples of either, sorted.
    before, after : GroundSums
        For these cubes. Exchanged, they give the same with the sign changed.
    reach : float
        In widths of a cube, at most 1: samples of one survey within it of the other's are on the
        same ground or near it.
    threads : int
        The answer does not depend on it.

    Returns
    -------
    GroundDistance

    Notes
    -----
    Some ten microseconds per cube. Reach is counted between voxels, a quarter of a cube each.
    """
    count = len(keys)
    result = GroundDistance(
        np.full(count, np.nan, np.float32),
        np.full(count, np.nan, np.float32),
        np.full(count, np.nan, np.float32),
        np.zeros(count, np.uint8),
        np.zeros(count, np.uint8),
    )
    steps = _steps_within(reach)

    def work(begin: int, end: int) -> None:
        _measure(
            keys, before.sums, after.sums, before.voxels, after.voxels, steps, begin, end,
            result.distance, result.error, result.scatter, result.lost, result.gained,
        )  # fmt: skip

    in_chunks(work, count, threads=threads, chunk=1 << 14)
    return result


def _steps_within(reach: float) -> Int8:
    """Steps (S, 3) from a voxel to those within reach, the nearest first, itself foremost."""
    voxels = min(4.0 * reach, float(_REACH_VOXELS))
    side = np.arange(-_REACH_VOXELS, _REACH_VOXELS + 1)
    steps = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1).reshape(-1, 3)
    square = (steps**2).sum(axis=1)
    order = np.lexsort([*steps.T, square])
    near: Int8 = np.ascontiguousarray(steps[order[square[order] <= voxels**2]].astype(np.int8))
    return near


def fit_planes(first: Float64, second: Float64, axis: int) -> Float64:
    """Fit two parallel planes to each pair of groups of samples, by their sums.

    Parameters
    ----------
    first, second : ndarray of shape (R, 10), float64
        Count (5 or more), sums of x, y, z and of xx, yy, zz, xy, xz, yz.
    axis : int
        0 to 2: what is explained by the other two.

    Returns
    -------
    ndarray of shape (R, 4), float64
        The second's height over the first's along the axis; the variance of that; the variance of
        the samples about their planes along the axis; the normal's component along the axis.
    """
    fits = np.empty((len(first), 4))
    _fit_planes(first, second, axis, fits)
    return fits


@numba.njit(cache=True, nogil=True)
def _fit_planes(
    first: Float64, second: Float64, axis: int, fits: Float64
) -> None:  # pragma: no cover - compiled
    for row in range(len(first)):
        _common_slope(first[row], second[row], axis, fits[row])


@numba.njit(cache=True, nogil=True)
def _common_slope(
    first: Float64, second: Float64, axis: int, fit: Float64
) -> None:  # pragma: no cover - compiled
    b, c = (axis + 1) % 3, (axis + 2) % 3
    # Products of two axes stand at 3 + 1 + 2 (xy), 3 + 0 + 2 (xz), ...: 6 less the axis left out.
    ab, ac, bc = PRODUCT + 5 - c, PRODUCT + 5 - b, PRODUCT + 5 - axis
    m, n = first[COUNT], second[COUNT]
    mb, nb = first[MEAN + b] / m, second[MEAN + b] / n
    mc, nc = first[MEAN + c] / m, second[MEAN + c] / n
    ma, na = first[MEAN + axis] / m, second[MEAN + axis] / n
    # (1) Scatter within each survey, about its own mean.
    bb1 = first[PRODUCT + b] - m * mb * mb
    bb2 = second[PRODUCT + b] - n * nb * nb
    cc1 = first[PRODUCT + c] - m * mc * mc
    cc2 = second[PRODUCT + c] - n * nc * nc
    bc1, bc2 = first[bc] - m * mb * mc, second[bc] - n * nb * nc
    ab1, ab2 = first[ab] - m * ma * mb, second[ab] - n * na * nb
    ac1, ac2 = first[ac] - m * ma * mc, second[ac] - n * na * nc
    aa1 = first[PRODUCT + axis] - m * ma * ma
    aa2 = second[PRODUCT + axis] - n * na * na
    # (2) The slope that both share.
    bb = bb1 + bb2 + _RIDGE * (m + n)
    cc = cc1 + cc2 + _RIDGE * (m + n)
    cross = bc1 + bc2
    size = bb * cc - cross * cross
    rise_b = ((ab1 + ab2) * cc - (ac1 + ac2) * cross) / size
    rise_c = ((ac1 + ac2) * bb - (ab1 + ab2) * cross) / size
    # (3) What it leaves of each.
    left1 = aa1 - 2 * (rise_b * ab1 + rise_c * ac1)
    left1 += rise_b * rise_b * bb1 + rise_c * rise_c * cc1 + 2 * rise_b * rise_c * bc1
    left2 = aa2 - 2 * (rise_b * ab2 + rise_c * ac2)
    left2 += rise_b * rise_b * bb2 + rise_c * rise_c * cc2 + 2 * rise_b * rise_c * bc2
    left1, left2 = max(left1, 0.0), max(left2, 0.0)
    pooled = (left1 + left2) / (m + n - 4.0)
    # (4) Distance, and its variance: of both heights, and of the slope over what lies between.
    db, dc = nb - mb, nc - mc
    lever = (db * db * cc - 2 * db * dc * cross + dc * dc * bb) / size
    fit[0] = na - ma - rise_b * db - rise_c * dc
    fit[1] = left1 / (m * (m - 1.0)) + left2 / (n * (n - 1.0)) + pooled * lever
    fit[2] = pooled
    fit[3] = 1.0 / np.sqrt(1.0 + rise_b * rise_b + rise_c * rise_c)


@numba.njit(cache=True, nogil=True)
def _measure(
    keys: Int64,
    before: Int32,
    after: Int32,
    before_voxels: UInt64,
    after_voxels: UInt64,
    steps: Int8,
    begin: int,
    end: int,
    distance: Float32,
    error: Float32,
    scatter: Float32,
    lost: UInt8,
    gained: UInt8,
) -> None:  # pragma: no cover - compiled
    near = np.empty(27, dtype=np.int64)
    first, second = np.empty(10), np.empty(10)
    within, fit = np.empty(6), np.empty(4)
    for cube in range(begin, end):
        _neighbours(keys, cube, near)
        lost[cube] = _out_of_reach(before_voxels[cube], after_voxels, near, steps)
        gained[cube] = _out_of_reach(after_voxels[cube], before_voxels, near, steps)
        # (1) The axis that the ground of the 27 cubes faces.
        _gather(before, near, -1, first)
        _gather(after, near, -1, second)
        axis = _facing(first, second, within)
        # (2) The column along it.
        _gather(before, near, axis, first)
        _gather(after, near, axis, second)
        if first[COUNT] < LEAST or second[COUNT] < LEAST:
            continue
        _common_slope(first, second, axis, fit)
        distance[cube] = fit[0] * fit[3] / TICKS
        error[cube] = np.sqrt(fit[1]) * fit[3] / TICKS
        scatter[cube] = np.sqrt(fit[2]) * fit[3] / TICKS


@numba.njit(cache=True, nogil=True)
def _neighbours(keys: Int64, cube: int, near: Int64) -> None:  # pragma: no cover - compiled
    """Rows of the 27 cubes around, itself in the middle; -1 where there is none."""
    for x in range(3):
        for y in range(3):
            # Three cubes along z follow each other, as far as they are there.
            base = keys[cube] + ((x - 1) << (2 * KEY_BITS)) + ((y - 1) << KEY_BITS) - 1
            low, high = 0, len(keys)
            while low < high:
                middle = (low + high) >> 1
                if keys[middle] < base:
                    low = middle + 1
                else:
                    high = middle
            for z in range(3):
                at = (x * 3 + y) * 3 + z
                near[at] = -1
                if low < len(keys) and keys[low] == base + z:
                    near[at] = low
                    low += 1


@numba.njit(cache=True, nogil=True)
def _gather(
    sums: Int32, near: Int64, axis: int, into: Float64
) -> None:  # pragma: no cover - compiled
    """Sum up the 27 cubes, or (axis 0 to 2) the three in a row, about the middle one's middle."""
    for column in range(10):
        into[column] = 0.0
    for at in range(27):
        row = near[at]
        if row < 0:
            continue
        x, y, z = at // 9 - 1, at // 3 % 3 - 1, at % 3 - 1
        if (axis == 0 and (y or z)) or (axis == 1 and (x or z)) or (axis == 2 and (x or y)):
            continue
        n = float(sums[row, COUNT])
        dx, dy, dz = float(x * TICKS), float(y * TICKS), float(z * TICKS)
        sx, sy, sz = float(sums[row, 1]), float(sums[row, 2]), float(sums[row, 3])
        into[COUNT] += n
        into[MEAN] += sx + n * dx
        into[MEAN + 1] += sy + n * dy
        into[MEAN + 2] += sz + n * dz
        into[PRODUCT] += sums[row, 4] + 2 * dx * sx + n * dx * dx
        into[PRODUCT + 1] += sums[row, 5] + 2 * dy * sy + n * dy * dy
        into[PRODUCT + 2] += sums[row, 6] + 2 * dz * sz + n * dz * dz
        into[PRODUCT + 3] += sums[row, 7] + dx * sy + dy * sx + n * dx * dy
        into[PRODUCT + 4] += sums[row, 8] + dx * sz + dz * sx + n * dx * dz
        into[PRODUCT + 5] += sums[row, 9] + dy * sz + dz * sy + n * dy * dz


@numba.njit(cache=True, nogil=True)
def _facing(first: Float64, second: Float64, within: Float64) -> int:  # pragma: no cover
    """Axis across which both surveys' samples spread widest: the largest minor."""
    for column in range(6):
        within[column] = first[PRODUCT + column] + second[PRODUCT + column]
    for which in range(2):
        group = first if which == 0 else second
        n = max(group[COUNT], 1.0)
        x, y, z = group[MEAN] / n, group[MEAN + 1] / n, group[MEAN + 2] / n
        within[0] -= n * x * x
        within[1] -= n * y * y
        within[2] -= n * z * z
        within[3] -= n * x * y
        within[4] -= n * x * z
        within[5] -= n * y * z
    minor_x = within[1] * within[2] - within[5] * within[5]
    minor_y = within[0] * within[2] - within[4] * within[4]
    minor_z = within[0] * within[1] - within[3] * within[3]
    if minor_y >= minor_x and minor_y >= minor_z:
        return 1
    return 0 if minor_x >= minor_z else 2


@numba.njit(cache=True, nogil=True)
def _out_of_reach(
    mine: np.uint64, others: UInt64, near: Int64, steps: Int8
) -> int:  # pragma: no cover - compiled
    """Voxels of a cube that have none of the other survey's within reach."""
    count = 0
    for bit in range(64):
        if not (mine >> np.uint64(bit)) & np.uint64(1):
            continue
        x, y, z = 4 + bit // 16, 4 + bit // 4 % 4, 4 + bit % 4
        covered = False
        for step in range(len(steps)):
            i, j, k = x + steps[step, 0], y + steps[step, 1], z + steps[step, 2]
            row = near[(i // 4 * 3 + j // 4) * 3 + k // 4]
            if row < 0:
                continue
            place = np.uint64(i % 4 * 16 + j % 4 * 4 + k % 4)
            if (others[row] >> place) & np.uint64(1):
                covered = True
                break
        count += not covered
    return count
