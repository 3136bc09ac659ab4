"""Regions scored against pieces of ground that people drew, in plan.

Both are brought to one raster. A drawing is a list of rings, later ones over earlier ones, as
people draw: a field, then the hut in it. Ground within ``TRANSITION_M`` of a drawn border, and
ground that nobody drew, is not scored; a border lies where two drawn regions come nearer than
``GAP_M``, midway.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64, Int32
from terraport_research.segmentation_scores import rand_error

__all__ = [
    "CELL_M",
    "DISTANCES_M",
    "PlanScore",
    "drawn_regions",
    "filled_gaps",
    "inside_ring",
    "plan_score",
]

CELL_M: Final = 0.5
TRANSITION_M: Final = 1.0
GAP_M: Final = 3.0
DISTANCES_M: Final = (1.5, 3.0)
"""Within which a border counts as found."""
_COUNTED: Final = 0.002
"""Share of the scored ground above which a region counts as one."""


@dataclass(frozen=True, slots=True)
class PlanScore:
    """How regions agree with one drawing."""

    rand_error: float
    """1 - Rand index over the scored cells."""
    recall: tuple[float, ...]
    """Share of the drawn border with a found one within each of ``DISTANCES_M``."""
    precision: tuple[float, ...]
    """Share of the found border with a drawn one within each."""
    regions_per_drawn: float
    largest_share: float
    """Share of the scored ground in the largest region."""
    drawn_share: float
    """Share of the piece's ground that is drawn, transitions left out."""

    def f_score(self, distance: int) -> float:
        """Harmonic mean of recall and precision at the distance of this number."""
        recall, precision = self.recall[distance], self.precision[distance]
        return 2.0 * recall * precision / max(recall + precision, 1e-12)


def inside_ring(points: Float64, ring: Float64) -> Bool:
    """Say which points (N, 2) lie inside a closed ring, by the even-odd rule."""
    inside = np.zeros(len(points), np.bool_)
    x, y = points.T
    for (x0, y0), (x1, y1) in pairwise(ring):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return inside


def drawn_regions(
    rings: Sequence[AnyFloat], numbers: Sequence[int], box: Sequence[float]
) -> tuple[Float64, Int32]:
    """Bring rings to the raster of a piece.

    Parameters
    ----------
    rings : sequence of ndarray of shape (K, 2)
        Closed; a later one lies over earlier ones.
    numbers : sequence of int
        Region of each ring; -1 for ground that is left out.
    box : west, south, east, north

    Returns
    -------
    middles : ndarray of shape (rows, columns, 2)
        Of the cells, the rings' frame.
    regions : ndarray of shape (rows, columns), int32
    """
    west, south, east, north = box
    x = np.arange(west + CELL_M / 2, east, CELL_M)
    y = np.arange(south + CELL_M / 2, north, CELL_M)
    middles = np.stack(np.meshgrid(x, y), axis=-1)
    points = middles.reshape(-1, 2)
    regions = np.full(len(points), -1, np.int32)
    for ring, number in zip(rings, numbers, strict=True):
        regions[inside_ring(points, np.asarray(ring, np.float64))] = number
    return middles, regions.reshape(middles.shape[:2])


def plan_score(drawn: Int32, found: AnyInt, ground: Bool) -> PlanScore:
    """Score found regions against drawn ones.

    Parameters
    ----------
    drawn : ndarray of shape (rows, columns), int32
        -1 where nothing is drawn.
    found : ndarray of the same shape, integer
    ground : ndarray of the same shape, bool
        Where the survey has ground at all.
    """
    drawn = np.where(ground, drawn, -1)
    filled = filled_gaps(drawn, ground)
    true_border = _border(filled)
    scored = drawn >= 0
    if true_border.any():
        scored &= distance_transform_edt(~true_border) * CELL_M > TRANSITION_M
    found_border = _border(np.where(filled >= 0, found, -1))
    areas = np.unique(found[scored], return_counts=True)[1]
    return PlanScore(
        rand_error(drawn[scored], found[scored]),
        tuple(_near(true_border, found_border, within) for within in DISTANCES_M),
        tuple(_near(found_border, true_border, within) for within in DISTANCES_M),
        float((areas > _COUNTED * scored.sum()).sum() / len(np.unique(drawn[scored]))),
        float(areas.max() / scored.sum()),
        float(scored.sum() / ground.sum()),
    )


def filled_gaps(drawn: Int32, ground: Bool) -> Int32:
    """Give ground within ``GAP_M`` of a drawn region that region, the nearest."""
    distance, (row, column) = distance_transform_edt(drawn < 0, return_indices=True)
    filled: Int32 = np.where((distance * CELL_M <= GAP_M) & ground, drawn[row, column], -1)
    return filled


def _border(regions: AnyInt) -> Bool:
    """Cells whose left or lower neighbour is of another region, both being of one."""
    border = np.zeros(regions.shape, np.bool_)
    for axis in (0, 1):
        here, there = (np.swapaxes(regions, 0, axis)[rows] for rows in (slice(1, None), slice(-1)))
        differs = (here != there) & (here >= 0) & (there >= 0)
        np.swapaxes(border, 0, axis)[1:] |= differs
    return border


def _near(border: Bool, other: Bool, within_m: float) -> float:
    """Share of a border that has the other within a distance; 1 of none, 0 near none."""
    if not border.any():
        return 1.0
    if not other.any():
        return 0.0
    return float((distance_transform_edt(~other) * CELL_M <= within_m)[border].mean())
