"""Volumes of regions above and below a reference surface that is triangulated over their toe.

Surveyors use this reference for a stockpile on uneven ground whose whole toe is visible. The toe
consists of the cells just outside the region, at inner borders too, in a raster of the highest
surface; the reference is its Delaunay triangulation, with linear heights. Volumes above and below
the reference are separate sums: Pix4D calls them cut and fill of the "Triangulated" base surface.
They distinguish a pile from a pit.

Uncertainty (:mod:`terraport_pipeline.geometry.volumes.volume_error`). A shift of the whole survey
moves pile and toe alike, and cancels out. The remaining errors:

- noise of the points on the surface, independent: a point represents the square of the spacing;
- noise of the points at the toe, independent, each weighted with the area of the reference that
  depends on it;
- the height of the toe, shared: three quarters of the height difference to the ground at twice the
  distance;
- the placement of the border, shared: a quarter of a spacing or cell, times the height of the
  surface above the reference there, along the border;
- the bias from summing only one sign of the noise around the reference.

Two parts of a volume may not be material: objects with flanks steeper than loose material allows
(trees, machines, walls), found by the filter of K. Zhang et al., and empty space under overhangs.
Neither is subtracted from the volumes.

References
----------
Pix4D, "Which Base Surface is recommended for the Volume Calculation?", PIX4Dmapper support, article
217114246. B. Delaunay, "Sur la sphère vide", Bulletin de l'Académie des Sciences de l'URSS 6, 1934.
K. Zhang et al., "A progressive morphological filter for removing nonground measurements from
airborne LIDAR data", IEEE Transactions on Geoscience and Remote Sensing 41, 2003. Differences:
window sizes double, and heights below an object are interpolated from the cells around it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64
from terraport_pipeline.geometry.volumes.volume_error import clipping_bias, interval_m3, noise_m3

__all__ = ["SurveyNoise", "ToeVolume", "toe_volumes"]

MAX_CELLS: Final = 20_000
"""Cells of a region that are summed up: of a larger one every n-th each way."""

MAX_TOE: Final = 4_000
"""Maximum number of toe cells that are triangulated; a longer toe uses every n-th cell."""

LEAST_CELLS: Final = 50
"""Cells of a region below which its volume is left out: it would be all border."""

_TOE_SPACINGS: Final = 2.0
"""Distance of the toe from the border, in spacings of the points or cells: triangles there do not
reach onto the region."""

_CLOSED: Final = 2.0
"""Half the width of notches in a border that are closed, in multiples of that distance."""

_LIFT: Final = 0.75
"""Standard deviation of the toe's height, as a share of its difference to the ground at twice the
distance."""

_PLACEMENT: Final = 0.25
"""Standard deviation of the placement of a region's border, in spacings or cells."""

_STEEP: Final = 1.0
"""Slope above which flanks belong to an object: loose material is stable up to 0.9 (42 degrees)."""

_WIDEST_OBJECT_M: Final = 12.0
"""Maximum width of an object, such as a crown or a machine; anything wider is ground."""

_NOISE_DEVIATIONS: Final = 4.0
"""Standard deviations by which the lowest of many noisy heights may be below their mean."""


@dataclass(frozen=True, slots=True)
class SurveyNoise:
    """Spacing and noise of the points of a surface."""

    spacing_m: float
    noise_m: float
    """Standard deviation of the points across their surface."""


@dataclass(frozen=True, slots=True)
class ToeVolume:
    """Volume between a region's surface and the one triangulated between its border's points."""

    above_m3: float
    below_m3: float
    uncertainty_m3: float | None
    """Half the 95 % interval of either volume; None if the noise of the survey is not known."""
    objects_m3: float
    """Part of `above_m3` in objects with flanks too steep for loose material."""
    overhang_m3: float
    """Empty space below the region's surface, where it is seen from above: part of `above_m3`, or
    missing from `below_m3`."""


def toe_volumes(
    height_m: AnyFloat,
    region: AnyInt,
    cell_m: float,
    wanted: Iterable[int],
    survey: SurveyNoise | None = None,
    empty_m: AnyFloat | None = None,
) -> dict[int, ToeVolume]:
    """Compute the volumes of regions over a raster of heights.

    Parameters
    ----------
    height_m : ndarray of shape (rows, columns)
        Metres; NaN without a surface.
    region : ndarray of shape (rows, columns), int
        Region of each cell; negative for none.
    cell_m : float
        Side of a cell.
    wanted : iterable of int
        Regions to measure.
    survey : SurveyNoise, optional
    empty_m : ndarray of shape (rows, columns), optional
        Height of the empty space below the surface of each cell.

    Returns
    -------
    dict of int to ToeVolume
        Regions that are too small for a volume are missing.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(-50.0, 51.0), np.arange(-50.0, 51.0))
    >>> cone = np.maximum(20.0 - np.hypot(x, y) / 2, 0.0)
    >>> volume = toe_volumes(cone, np.where(cone > 0, 3, 0), 1.0, [3])[3]
    >>> round(volume.above_m3 / (np.pi * 40**2 * 20 / 3), 2), volume.below_m3 < 100
    (1.0, True)
    """
    labels = np.where(np.isnan(height_m), -1, region).astype(np.int32)
    boxes = ndimage.find_objects(labels + 1)
    margin = 1 + 2 * max(_windows(cell_m), default=0)
    volumes = {}
    for number in wanted:
        box = boxes[number] if 0 <= number < len(boxes) else None
        if box is None:
            continue
        rows, columns = (slice(max(side.start - margin, 0), side.stop + margin) for side in box)
        inside = labels[rows, columns] == number
        if int(inside.sum()) < LEAST_CELLS:
            continue
        heights = height_m[rows, columns].astype(np.float64)
        empty = 0.0 if empty_m is None else float(empty_m[rows, columns][inside].sum())
        volume = _volume(heights, inside, cell_m, survey, empty * cell_m**2)
        if volume is not None:
            volumes[number] = volume
    return volumes


def _volume(
    heights: Float64, inside: Bool, cell_m: float, survey: SurveyNoise | None, overhang_m3: float
) -> ToeVolume | None:
    """Measure one region; None if no reference can be triangulated over its toe."""
    # (1) The reference at each cell: weights of three points of the toe.
    spacing_m = cell_m if survey is None else survey.spacing_m
    away_m = _TOE_SPACINGS * max(spacing_m, cell_m)
    places, toe_m, rise_m = _toe(heights, inside, away_m / cell_m)
    some = slice(None, None, -(-len(places) // MAX_TOE))
    places, toe_m, rise_m = places[some], toe_m[some], rise_m[some]
    try:
        triangles = Delaunay(places)
    except QhullError:  # all points of the border are collinear
        return None
    cells = np.argwhere(inside)
    step = int(np.ceil(np.sqrt(len(cells) / MAX_CELLS)))
    if step > 1:
        cells = cells[(cells % step == 0).all(axis=1)]
    simplex = triangles.find_simplex(cells)
    cells, simplex = cells[simplex >= 0], simplex[simplex >= 0]
    if not len(cells):
        return None
    affine = triangles.transform[simplex]
    first = np.einsum("nij,nj->ni", affine[:, :2], cells - affine[:, 2])
    shares = np.column_stack([first, 1.0 - first.sum(axis=1)])
    corners = triangles.simplices[simplex]
    good = np.isfinite(shares).all(axis=1)  # a degenerate triangle has no weights
    cells, shares, corners = cells[good], shares[good], corners[good]
    # (2) Volumes above and below the reference.
    over_m = heights[cells[:, 0], cells[:, 1]] - (shares * toe_m[corners]).sum(axis=1)
    cell_m2 = float(inside.sum()) * cell_m**2 / max(len(cells), 1)
    above = over_m > 0
    # (3) Uncertainty, and the parts that may not be material.
    uncertainty_m3 = None
    if survey is not None:
        place_m = _PLACEMENT * max(survey.spacing_m, cell_m)
        rim = inside & ~ndimage.binary_erosion(inside)
        at_rim = rim[cells[:, 0], cells[:, 1]]
        rim_m2 = float(rim.sum()) * cell_m * place_m
        either = []
        for side in (above, ~above):
            weight_m2 = cell_m2 * np.bincount(
                corners[side].ravel(), shares[side].ravel(), len(toe_m)
            )
            # Toe cells that are closer together than the points share one error.
            alike = max(survey.spacing_m / (cell_m * (some.step or 1)), 1.0)
            either.append(
                interval_m3(
                    noise_m3(cell_m2 * side.sum(), survey.spacing_m, survey.noise_m),
                    float(np.sqrt(alike * (weight_m2**2).sum())) * survey.noise_m,
                    float((weight_m2 * rise_m).sum()) * _LIFT,
                    float(np.abs(over_m[side & at_rim]).sum()) / max(at_rim.sum(), 1) * rim_m2,
                )
            )
        bias_m3 = cell_m2 * float(clipping_bias(over_m, survey.noise_m).sum())
        uncertainty_m3 = max(either) + bias_m3
    noise_m = 0.0 if survey is None else survey.noise_m
    return ToeVolume(
        cell_m2 * float(over_m[above].sum()),
        -cell_m2 * float(over_m[~above].sum()),
        uncertainty_m3,
        _objects_m(heights, inside, cell_m, noise_m) * cell_m**2,
        overhang_m3,
    )


def _toe(heights: Float64, inside: Bool, away_cells: float) -> tuple[Float64, Float64, Float64]:
    """Return the toe of a region: positions (row, column), heights in metres, and height steps.

    Triangles that cross the toe of a pile lift the surface just outside of it, and the border of a
    region is only as exact as its triangles. So heights are taken at a distance from the border, at
    the positions of those cells, which is exact on a slope. At the rim of the survey the region's
    own edge cells are used. A height step is the difference to the ground at twice the distance.
    """
    # (1) The region without notches in its border: a point in one would carry the reference of a
    # large part of the region.
    wide = int(np.ceil(_CLOSED * away_cells)) + 1
    padded = np.pad(inside, wide)
    near = ndimage.distance_transform_edt(~padded) <= _CLOSED * away_cells
    closed = padded | (ndimage.distance_transform_edt(near) > _CLOSED * away_cells)
    cut = slice(wide - 1, 1 - wide)
    padded, closed = padded[cut, cut], closed[cut, cut]
    # (2) The ground at the distance of the toe.
    around = np.pad(heights, 1, constant_values=np.nan)
    ground = ~np.isnan(around)
    distance = ndimage.distance_transform_edt(~closed)
    ring = ground & (distance > away_cells) & (distance <= away_cells + 1.0)
    # In a gap narrower than that, the cells next to the region are used.
    reached = ndimage.distance_transform_edt(~ring) <= 2.0 * away_cells + 2.0
    ring |= ground & (distance > 0) & (distance <= 1.0) & ~reached
    places, values = [np.argwhere(ring) - 1.0], [around[ring]]
    farther = ground & (distance > 2.0 * away_cells) & (distance <= 2.0 * away_cells + 1.0)
    rises = [np.zeros(int(ring.sum()))]
    if farther.any():
        row, column = ndimage.distance_transform_edt(
            ~farther, return_distances=False, return_indices=True
        )
        rises = [around[ring] - around[row[ring], column[ring]]]
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        back = (-step[0], -step[1])
        edge = padded & ~np.roll(ground, back, axis=(0, 1))
        places.append(np.argwhere(edge) - 1.0 + 0.5 * np.array(step))
        values.append(around[edge])
        rises.append(np.zeros(int(edge.sum())))
    return np.concatenate(places), np.concatenate(values), np.concatenate(rises)


def _windows(cell_m: float) -> list[int]:
    """Return the half widths of the windows in which objects are detected, cells: 1, 2, 4, ..."""
    widest = _WIDEST_OBJECT_M / 2 / cell_m
    return [1 << k for k in range(12) if 1 << k <= max(widest, 1.0)]


def _objects_m(heights: Float64, inside: Bool, cell_m: float, noise_m: float) -> float:
    """Sum up, over a region's cells, the heights of objects with steep flanks."""
    ground = ~np.isnan(heights)
    opened, half, marked = heights, 0, np.zeros_like(inside)
    for window in _windows(cell_m):
        size = 2 * window + 1
        low = ndimage.minimum_filter(np.where(ground, opened, np.inf), size, mode="nearest")
        low[np.isinf(low)] = -np.inf
        wider = ndimage.maximum_filter(low, size, mode="nearest")
        # Corners of a window are further from its centre than its sides.
        most_m = _STEEP * np.sqrt(2.0) * (window - half) * cell_m + _NOISE_DEVIATIONS * noise_m
        marked |= ground & (opened - wider > most_m)
        opened, half = np.where(ground, np.minimum(opened, wider), np.nan), window
    if not (marked & inside).any():
        return 0.0
    # The foot of a flank is not steep; the surface below an object continues that around it.
    marked = ground & ndimage.binary_dilation(marked, iterations=2)
    around = ground & ndimage.binary_dilation(marked, iterations=2) & ~marked
    try:
        bare = LinearNDInterpolator(np.argwhere(around), heights[around])
    except (QhullError, ValueError):
        return 0.0
    cells = marked & inside
    steps_m = heights[cells] - bare(np.argwhere(cells))
    return float(np.maximum(np.nan_to_num(steps_m), 0.0).sum())
