"""Charts that an image has room for, and flat colours for the faces that are left.

An image of 2048 x 2048 has 16,384 cells of the smallest size. As many charts as fill a quarter of
them are kept: more gutters would take what the texels of all others need. Of more the smallest are
given up, those without a photo first, and their faces get one flat colour each, that of their
vertices. So do faces without area, which have no place in any chart, and beside photos the faces of
charts without one that are no larger than a few texels: they show no more than that, and their
gutters took two fifths of all texels of a noisy survey. Flat colours are shared: close ones lie in
one cell, so all of them together take a small corner of the image.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Bool, Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.textures.atlas_pack import SMALLEST_CELL
from terraport_pipeline.geometry.textures.charts import Charts, make_charts

__all__ = ["MOST_FLAT", "FlatColours", "RoomyCharts", "charts_with_room", "flat_colours"]

_CHART_SHARE: Final = 0.25
"""Share of the image's smallest cells that charts may take at most."""

_PLAIN_WORTH: Final = 0.1
"""Worth of an area without a photo, whose texels show no more than vertex colours do."""

_SPECK_TEXELS: Final = 4.0
"""Longest side of a chart without a photo that is not worth its gutters: two faces each way."""

_SPECK_FACES: Final = 64
"""Faces below which it is not either: its gutters take as many texels as it has."""

MOST_FLAT: Final = 256
"""Flat colours of one image at most; as many of the smallest cells."""

_BITS: Final = (5, 4, 3, 2)
"""Bits a channel that colours of one cell share, tried until there are few enough."""


@dataclass(frozen=True, slots=True, eq=False)
class RoomyCharts:
    """Charts of some of F faces; the others have flat colours."""

    charts: Charts | None
    """Of the faces `rows`; None where there are none."""
    rows: npt.NDArray[np.intp]
    """(R,) faces that are in charts, ascending."""
    crowded: Bool
    """(F,) faces that have no chart for want of room."""


@dataclass(frozen=True, slots=True, eq=False)
class FlatColours:
    """A few colours that K faces without a photo share, and which is whose."""

    of_face: Int32
    """(K,) row of each face's colour."""
    colours: UInt8
    """(C, 3) sRGB."""


def charts_with_room(
    points: Float64,
    corners: Int32,
    view: Int32,
    packed: Float64,
    *,
    texel_m: float | None,
    max_side: int,
    pixels: Float32 | None = None,
) -> RoomyCharts:
    """Cut a mesh into no more charts than an image has room for.

    Parameters
    ----------
    points : ndarray of shape (V, 3), float64
    corners : ndarray of shape (F, 3), int32
    view : ndarray of shape (F,), int32
    packed : ndarray of shape (views, PACKED), float64
    texel_m, pixels
        As for :func:`~terraport_pipeline.geometry.textures.charts.make_charts`.
    max_side : int
        Longest side of the image, texels.

    Returns
    -------
    RoomyCharts
    """
    edge_a = points[corners[:, 1]] - points[corners[:, 0]]
    edge_b = points[corners[:, 2]] - points[corners[:, 0]]
    rows = np.flatnonzero(np.any(np.cross(edge_a, edge_b) != 0.0, axis=1))
    crowded = np.zeros(len(corners), np.bool_)
    room = int((max_side // SMALLEST_CELL) ** 2 * _CHART_SHARE)
    specks = len(packed) > 0
    while len(rows):
        charts = make_charts(
            points, corners[rows], view[rows], packed, texel_m=texel_m,
            pixels=None if pixels is None else pixels[rows],
        )  # fmt: skip
        area = np.bincount(charts.chart, _worth(charts), charts.count)
        kept = np.ones(charts.count, np.bool_)
        if specks:
            kept[charts.chart[charts.view < 0]] = False
            count = np.bincount(charts.chart, minlength=charts.count)
            kept |= (charts.sizes.max(axis=1) > _SPECK_TEXELS) & (count >= _SPECK_FACES)
            specks = False
        if kept.sum() > room:
            first = np.argsort(np.where(kept, -area, np.inf), kind="stable")[:room]
            beyond = kept.copy()
            beyond[first] = False
            kept &= ~beyond
            crowded[rows[beyond[charts.chart]]] = True
        if kept.all():
            return RoomyCharts(charts, rows, crowded)
        # Without the smallest the others are as they were, so the next time they fit.
        rows = rows[kept[charts.chart]]
    return RoomyCharts(None, rows, crowded)


def _worth(charts: Charts) -> Float64:
    worth: Float64 = np.where(charts.view >= 0, 1.0, _PLAIN_WORTH) * charts.surface_m2
    return worth


def flat_colours(colours: UInt8) -> FlatColours:
    """Find a few colours for many faces.

    Parameters
    ----------
    colours : ndarray of shape (K, 3), uint8
        sRGB; K may be 0.

    Returns
    -------
    FlatColours
        At most :data:`MOST_FLAT`; none is farther than its share of the scale from its faces'.

    Examples
    --------
    >>> found = flat_colours(np.array([[10, 10, 10], [200, 0, 0], [12, 10, 10]], np.uint8))
    >>> found.of_face.tolist(), found.colours.tolist()
    ([0, 1, 0], [[11, 10, 10], [200, 0, 0]])
    """
    for bits in _BITS:
        channels = (colours >> (8 - bits)).astype(np.int32)
        keys = (channels[:, 0] << 2 * bits) | (channels[:, 1] << bits) | channels[:, 2]
        unique, rows = np.unique(keys, return_inverse=True)
        if len(unique) <= MOST_FLAT:
            break
    rows = rows.reshape(-1).astype(np.int32)
    count = np.maximum(np.bincount(rows, minlength=len(unique)), 1)
    mean = [
        np.bincount(rows, colours[:, channel].astype(np.float64), len(unique)) / count
        for channel in range(3)
    ]
    return FlatColours(rows, np.rint(np.stack(mean, axis=1)).astype(np.uint8))
