"""The ground that a cloud covers, seen from above: an outline to cut a surface to.

The cloud's outline is that of an alpha shape, made on a raster: the plane is covered by disks of
``closing`` local spacings about the samples, and the union is then drawn in again by the same
length, so that its border runs through the outermost samples. What a disk of that radius fits into
(a lake, a survey's notch) stays open; narrower gaps close. The result is a *margin*: metres inside
the outline (negative outside), smooth enough to cut along its zero line.

The raster is bounded (:data:`MAX_CELLS`), so one footprint serves a survey of any size: count the
samples of every chunk into :class:`Occupancy`, add up, and make the footprint once.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64
from terraport_pipeline.geometry.clouds.support import DENSITY_SPAN

__all__ = [
    "CLOSING_SPACINGS",
    "MAX_CELLS",
    "Footprint",
    "Occupancy",
    "make_footprint",
    "plan_occupancy",
    "window_of",
]

CLOSING_SPACINGS: Final = 4.0
"""Gaps up to twice this many spacings wide close; a gap of eight spacings holds some fifty samples'
worth of nothing, which chance does not leave."""

OUTWARD_SPACINGS: Final = 0.5
"""The outline lies this far beyond the outermost samples: each stands for a cell of one spacing."""

MAX_CELLS: Final = 1 << 24
"""Raster cells at most; making the footprint needs about 40 bytes for each."""

_CELLS_PER_SPACING: Final = 1.0
_SMOOTH_CELLS: Final = 1.0
"""Blur of the margin. Rounds the steps of the raster; a straight border stays where it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """A window of a raster over x and z that samples are counted into."""

    low: tuple[float, float]
    """x and z of the corner of the raster's cell (0, 0), metres, scene frame."""
    cell_m: float
    cloud_spacing_m: float
    spacing_m: Float32
    """(nx, nz) largest local spacing of the cell's samples; 0 where there is none."""
    first: tuple[int, int] = (0, 0)
    """The window's first cell."""

    def add(self, points: AnyFloat, local_spacing_m: Float32) -> None:
        """Count samples in; in any order, the result is the same.

        Parameters
        ----------
        points : ndarray of shape (N, 3)
            Metres, scene frame. Those outside the raster are left out.
        local_spacing_m : ndarray of shape (N,), float32
            Areal spacing around each; counts between the cloud's and
            :data:`~terraport_pipeline.geometry.clouds.support.DENSITY_SPAN` times it.
        """
        nx, nz = self.spacing_m.shape
        i = np.floor((points[:, 0] - self.low[0]) / self.cell_m).astype(np.int64) - self.first[0]
        j = np.floor((points[:, 2] - self.low[1]) / self.cell_m).astype(np.int64) - self.first[1]
        inside = (i >= 0) & (j >= 0) & (i < nx) & (j < nz)
        span_m = np.clip(local_spacing_m, self.cloud_spacing_m, DENSITY_SPAN * self.cloud_spacing_m)
        np.maximum.at(self.spacing_m.reshape(-1), (i * nz + j)[inside], span_m[inside])


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """Signed distance to a survey's outline seen from above, on a raster: metres inside."""

    low: tuple[float, float]
    """x and z of the *middle* of the raster's cell (0, 0)."""
    cell_m: float
    field_m: Float32
    """(nx, nz) margin at the middles of the window's cells."""
    first: tuple[int, int] = (0, 0)
    """The window's first cell."""

    def margin_m(self, points: AnyFloat) -> Float32:
        """Metres inside the outline, negative outside.

        Parameters
        ----------
        points : ndarray of shape (N, 3)
            Metres, scene frame; the height does not count. Beyond the raster its rim counts.

        Returns
        -------
        ndarray of shape (N,), float32
            Bilinear between the cells' middles. Depends on each point alone.
        """
        nx, nz = self.field_m.shape
        x = (points[:, 0].astype(np.float64) - self.low[0]) / self.cell_m - self.first[0]
        z = (points[:, 2].astype(np.float64) - self.low[1]) / self.cell_m - self.first[1]
        x, z = np.clip(x, 0, nx - 1.001), np.clip(z, 0, nz - 1.001)
        i, j = x.astype(np.int64), z.astype(np.int64)
        x, z = (x - i).astype(np.float32), (z - j).astype(np.float32)
        field, row = self.field_m.reshape(-1), i * nz + j
        near = field[row] * (1 - z) + field[row + 1] * z
        far = field[row + nz] * (1 - z) + field[row + nz + 1] * z
        margin: Float32 = near * (1 - x) + far * x
        return margin

    def within(self, low_m: Float64, high_m: Float64, most_m: float) -> Footprint:
        """Give the footprint for points in a box, (3,) metres, and for margins up to `most_m`."""
        windows, first = [], []
        for axis, count in enumerate(self.field_m.shape):
            side = 2 * axis  # x or z
            start = (float(low_m[side]) - self.low[axis]) / self.cell_m - self.first[axis]
            end = (float(high_m[side]) - self.low[axis]) / self.cell_m - self.first[axis]
            # A row more on each side, as points may lie on the box; two rows at least.
            low = int(np.clip(np.floor(start) - 1, 0, count - 2))
            high = int(np.clip(np.ceil(end) + 2, low + 2, count))
            windows.append(slice(low, high))
            first.append(self.first[axis] + low)
        window = np.minimum(self.field_m[windows[0], windows[1]], np.float32(most_m))
        return Footprint(self.low, self.cell_m, window, (first[0], first[1]))

    @property
    def area_m2(self) -> float:
        """Plan area inside the outline."""
        return float(np.count_nonzero(self.field_m >= 0)) * self.cell_m**2


def plan_occupancy(
    low: Float64, high: Float64, spacing_m: float, *, closing_spacings: float = CLOSING_SPACINGS
) -> Occupancy:
    """Lay out an empty raster.

    Parameters
    ----------
    low, high : ndarray of shape (3,)
        Box of the whole cloud, metres, scene frame.
    spacing_m : float
        The whole cloud's areal spacing.

    Returns
    -------
    Occupancy
        Cells of one spacing, wider where that would pass :data:`MAX_CELLS`, with room for the
        closing on every side.
    """
    room_m = (closing_spacings + 2) * DENSITY_SPAN * spacing_m
    width = float(high[0] - low[0]) + 2 * room_m
    depth = float(high[2] - low[2]) + 2 * room_m
    cell_m = max(spacing_m / _CELLS_PER_SPACING, float(np.sqrt(width * depth / MAX_CELLS)))
    shape = (int(width / cell_m) + 2, int(depth / cell_m) + 2)
    corner = (float(low[0]) - room_m, float(low[2]) - room_m)
    return Occupancy(corner, cell_m, spacing_m, np.zeros(shape, dtype=np.float32))


def window_of(raster: Occupancy, low: AnyInt, high: AnyInt) -> Occupancy:
    """Lay out the empty window of a raster that holds its cells `low` to `high`, (2,) each.

    With room for the closing on every side, as :func:`plan_occupancy` leaves it; what is drawn in
    the window does not depend on where it begins.
    """
    room_m = (CLOSING_SPACINGS + 2) * DENSITY_SPAN * raster.cloud_spacing_m
    room = int(np.ceil(room_m / raster.cell_m)) + 1
    first = (int(low[0]) - room, int(low[1]) - room)
    shape = (int(high[0]) + room + 1 - first[0], int(high[1]) + room + 1 - first[1])
    return replace(raster, spacing_m=np.zeros(shape, dtype=np.float32), first=first)


def make_footprint(
    occupancy: Occupancy, *, closing_spacings: float = CLOSING_SPACINGS
) -> Footprint:
    """Draw the outline of what was counted.

    Parameters
    ----------
    occupancy : Occupancy
        Of the whole cloud; not modified. At least one sample, and planned for this closing.
    closing_spacings : float
        Gaps up to twice this many local spacings wide close.

    Returns
    -------
    Footprint

    Notes
    -----
    Local spacings decide how far a sample reaches, so that the thin rim of a survey keeps together
    and its dense middle still shows its gaps. Linear in the cells.
    """
    cell_m, spacing_m = occupancy.cell_m, occupancy.spacing_m
    taken = spacing_m > 0
    # (1) Disks about the samples. A cell wider than the spacing holds several.
    distance_m, (i, j) = distance_transform_edt(~taken, sampling=cell_m, return_indices=True)
    reach_m = np.maximum(closing_spacings * spacing_m[i, j], 1.5 * cell_m).astype(np.float32)
    del i, j
    union = distance_m <= reach_m
    # (2) drawn in again: distance to what no disk covers
    within_m = distance_transform_edt(union, sampling=cell_m).astype(np.float32)
    outward_m = OUTWARD_SPACINGS / closing_spacings * reach_m
    margin_m = within_m - reach_m + outward_m
    # Outside the union the transform is 0 everywhere; the way back to it counts.
    margin_m[~union] -= (distance_m[~union] - reach_m[~union]).astype(np.float32)
    field_m = gaussian_filter(margin_m, _SMOOTH_CELLS, mode="nearest")
    low = (occupancy.low[0] + 0.5 * cell_m, occupancy.low[1] + 0.5 * cell_m)
    return Footprint(low, cell_m, field_m, occupancy.first)
