"""Compiled sums over the faces of regions: one pass over all faces, not one per region.

Every sum runs in the order of the faces on one thread, so the result does not depend on the number
of threads.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int32, UInt8

__all__ = [
    "attribute_sums",
    "face_areas",
    "region_sums",
    "slope_histogram",
    "squared_deviations",
]


@numba.njit(cache=True, nogil=True)
def face_areas(
    vertices: AnyFloat, faces: Int32, regions: Int32, count: int
) -> tuple[Float64, Float64, Float64, Float64]:
    """Area and slope of every face, area and plan area of every region.

    Returns ``(area (F,), area (R,), plan area (R,), slope (F,))``; slopes are degrees, 0 level to
    90 vertical or overhanging, 0 for faces without area.
    """
    area = np.empty(len(faces), np.float64)
    slope = np.empty(len(faces), np.float64)
    total = np.zeros(count, np.float64)
    plan = np.zeros(count, np.float64)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        # (1) The normal with the face's area as its length; y is up, so its share is the plan
        # area.
        ux = np.float64(vertices[b, 0]) - vertices[a, 0]
        uy = np.float64(vertices[b, 1]) - vertices[a, 1]
        uz = np.float64(vertices[b, 2]) - vertices[a, 2]
        wx = np.float64(vertices[c, 0]) - vertices[a, 0]
        wy = np.float64(vertices[c, 1]) - vertices[a, 1]
        wz = np.float64(vertices[c, 2]) - vertices[a, 2]
        nx = 0.5 * (uy * wz - uz * wy)
        ny = 0.5 * (uz * wx - ux * wz)
        nz = 0.5 * (ux * wy - uy * wx)
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        # (2) 0 level, 90 vertical or overhanging.
        steepness = 0.0
        if size > 0.0:
            steepness = np.degrees(np.arccos(min(max(ny / size, 0.0), 1.0)))
        area[f] = size
        slope[f] = steepness
        total[regions[f]] += size
        plan[regions[f]] += abs(ny)
    return area, total, plan, slope


@numba.njit(cache=True, nogil=True)
def region_sums(
    vertices: AnyFloat,
    faces: Int32,
    colours: UInt8,
    regions: Int32,
    weight: Float64,
    slope: Float64,
    count: int,
) -> tuple[Float64, Float64]:
    """Weighted sums and boxes of every region.

    Returns ``(sums (R, 8), boxes (R, 6))``; columns of the sums: weight, weight times x, y, z of
    the face's centre, times mean red, green, blue of its corners, times its slope; of the boxes:
    least x, y, z, greatest x, y, z.
    """
    sums = np.zeros((count, 8), np.float64)
    boxes = np.empty((count, 6), np.float64)
    boxes[:, :3] = np.inf
    boxes[:, 3:] = -np.inf
    for f in range(len(faces)):
        r, w = regions[f], weight[f]
        sums[r, 0] += w
        # Each face counts at its middle: the mean of its corners' positions and colours.
        for axis in range(3):
            centre = 0.0
            colour = 0.0
            for corner in range(3):
                v = faces[f, corner]
                value = np.float64(vertices[v, axis])
                centre += value
                colour += np.float64(colours[v, axis])
                if value < boxes[r, axis]:
                    boxes[r, axis] = value
                if value > boxes[r, axis + 3]:
                    boxes[r, axis + 3] = value
            sums[r, 1 + axis] += w * centre / 3.0
            sums[r, 4 + axis] += w * colour / 3.0
        sums[r, 7] += w * slope[f]
    return sums, boxes


@numba.njit(cache=True, nogil=True)
def slope_histogram(
    regions: Int32, weight: Float64, slope: Float64, count: int, bins: int
) -> Float64:
    """Weight of every region's faces by slope, (R, bins); bins cut 0..90 degrees evenly."""
    histogram = np.zeros((count, bins), np.float64)
    for f in range(len(regions)):
        histogram[regions[f], min(int(slope[f] * (bins / 90.0)), bins - 1)] += weight[f]
    return histogram


@numba.njit(cache=True, nogil=True)
def attribute_sums(
    values: AnyFloat, faces: Int32, regions: Int32, weight: Float64, count: int
) -> Float64:
    """Sum one attribute over the corners of every region's faces, NaN and infinity left out.

    Returns (R, 6): known corners, their weight, weighted sum, plain sum, least, greatest.
    """
    sums = np.zeros((count, 6), np.float64)
    sums[:, 4] = np.inf
    sums[:, 5] = -np.inf
    for f in range(len(faces)):
        r = regions[f]
        for corner in range(3):
            value = np.float64(values[faces[f, corner]])
            if not np.isfinite(value):
                continue
            sums[r, 0] += 1.0
            sums[r, 1] += weight[f]
            sums[r, 2] += weight[f] * value
            sums[r, 3] += value
            sums[r, 4] = min(sums[r, 4], value)
            sums[r, 5] = max(sums[r, 5], value)
    return sums


@numba.njit(cache=True, nogil=True)
def squared_deviations(
    values: AnyFloat, faces: Int32, regions: Int32, weight: Float64, mean: Float64
) -> Float64:
    """Weighted and plain sum of squared distances from the region's mean, (R, 2)."""
    sums = np.zeros((len(mean), 2), np.float64)
    for f in range(len(faces)):
        r = regions[f]
        for corner in range(3):
            value = np.float64(values[faces[f, corner]])
            if np.isfinite(value):
                square = (value - mean[r]) * (value - mean[r])
                sums[r, 0] += weight[f] * square
                sums[r, 1] += square
    return sums
