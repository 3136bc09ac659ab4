"""Volumes of regions above and below the surface that their border (the toe) spans.

The reference is what surveyors take for a stockpile whose whole toe is seen and whose ground is not
flat: the points of the border, triangulated. Here these are the cells of a raster of heights that
lie just outside the region, at inner borders too (Delaunay's triangles, heights linear over each).
What lies above the reference and what lies below it are two sums: Pix4D calls
them cut and fill of the base "Triangulated", which a pit and a pile tell apart.

References
----------
Pix4D, "Which Base Surface is recommended for the Volume Calculation?", PIX4Dmapper support, article
217114246. B. Delaunay, "Sur la sphère vide", Bulletin de l'Académie des Sciences de l'URSS 6, 1934.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64

__all__ = ["ToeVolume", "toe_volumes"]

MAX_CELLS: Final = 10_000
"""Cells of a region that are summed up: of a larger one every n-th each way."""

LEAST_CELLS: Final = 50
"""Cells of a region below which its volume is left out: it would be all border."""


@dataclass(frozen=True, slots=True)
class ToeVolume:
    """Volume between a region's surface and the one triangulated between its border's points."""

    above_m3: float
    below_m3: float
    cell_m: float
    """Side of the cells that were summed up."""
    middle: tuple[float, float]
    """(row, column) of the raster furthest from the region's border: where its number stands."""


def toe_volumes(
    height_m: AnyFloat, region: AnyInt, cell_m: float, wanted: Sequence[int]
) -> dict[int, ToeVolume]:
    """Sum up volumes of regions over a raster of heights.

    Parameters
    ----------
    height_m : ndarray of shape (rows, columns)
        Metres; NaN where no surface is.
    region : ndarray of shape (rows, columns), int
        Region of each cell; negative: none.
    cell_m : float
        Side of a cell.
    wanted : sequence of int
        Regions to measure.

    Returns
    -------
    dict of int to ToeVolume
        Regions too small for a volume are not in it.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(-50.0, 51.0), np.arange(-50.0, 51.0))
    >>> cone = np.maximum(20.0 - np.hypot(x, y) / 2, 0.0)
    >>> volume = toe_volumes(cone, np.where(cone > 0, 3, 0), 1.0, [3])[3]
    >>> round(volume.above_m3 / (np.pi * 40**2 * 20 / 3), 2), volume.below_m3 < 100
    (1.0, True)
    """
    labels = np.where(np.isnan(height_m), -1, region)
    boxes = ndimage.find_objects(labels + 1)
    volumes = {}
    for number in wanted:
        box = boxes[number] if 0 <= number < len(boxes) else None
        if box is None:
            continue
        # (1) The region in its box, with no more cells than are needed.
        inside = np.pad(labels[box] == number, 1)
        heights = _widened(height_m, box)
        step = max(1, int(np.ceil(np.sqrt(inside.sum() / MAX_CELLS))))
        inside, heights = inside[::step, ::step], heights[::step, ::step]
        side_m = cell_m * step
        if int(inside.sum()) < LEAST_CELLS:
            continue
        # (2) What lies between its surface and that of its toe.
        places, border_m = _toe(heights, inside)
        try:
            toe = LinearNDInterpolator(places, border_m)
        except QhullError:  # a border in one line
            continue
        over = heights[inside] - toe(np.argwhere(inside))
        over = over[np.isfinite(over)] * side_m**2
        depth = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(depth.argmax()), inside.shape)
        volumes[number] = ToeVolume(
            float(over[over > 0].sum()),
            float(-over[over < 0].sum()),
            side_m,
            (box[0].start - 0.5 + step * float(row), box[1].start - 0.5 + step * float(column)),
        )
    return volumes


def _widened(height_m: AnyFloat, box: tuple[slice, slice]) -> Float64:
    """Cut out a box with a rim of one cell around it; NaN beyond the raster."""
    rows, columns = height_m.shape
    top, left = box[0].start - 1, box[1].start - 1
    cut = height_m[max(top, 0) : box[0].stop + 1, max(left, 0) : box[1].stop + 1]
    beyond = (
        (int(top < 0), int(box[0].stop + 1 > rows)),
        (int(left < 0), int(box[1].stop + 1 > columns)),
    )
    return np.pad(cut.astype(np.float64), beyond, constant_values=np.nan)


def _toe(heights: Float64, inside: Bool) -> tuple[Float64, Float64]:
    """Take the cells just outside a region, where its toe stands: (row, column), and metres.

    Of the cells on both sides of a border the outer ones are the ground that a pile lies on; a mean
    of both would take a strip of half a cell's slope off the whole pile. At the rim of the ground
    the region's own cell counts, on its edge.
    """
    padded = np.pad(inside, 1)
    around = np.pad(heights, 1, constant_values=np.nan)
    places, values = [], []
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        back = (-step[0], -step[1])
        edge = padded & ~np.roll(padded, back, axis=(0, 1))
        other, own = np.roll(around, back, axis=(0, 1))[edge], around[edge]
        is_rim = np.isnan(other)
        away = np.where(is_rim, 0.5, 1.0)[:, None] * np.array(step)
        places.append(np.argwhere(edge) - 1.0 + away)
        values.append(np.where(is_rim, own, other))
    return np.concatenate(places), np.concatenate(values)
