"""Where the surface ends: one rule for the detail, one for the base.

Read from sums over all tiles, so that every tile is cut alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Occupancy, make_footprint, window_of
from terraport_pipeline.geometry.clouds.support import support_threshold

__all__ = ["BASE_GAP_SPACINGS", "HEM_SPACINGS", "edge_rules", "end_of_support"]

HEM_SPACINGS: Final = 1.5
"""How far the base reaches beyond the detail, in the cloud's spacings: thinning moves a border by
less than one (99.9th percentile), and the hem is hidden where detail is shown."""

BASE_GAP_SPACINGS: Final = 12.0
"""Gaps that nowhere lie farther than this from a sample stay closed in the base: the detail shows
the holes of a thinly sampled wall when one stands before it, but from afar nobody should look
through the wall. (Without this the base of a quarry's highwall had holes of several metres.)"""


def end_of_support(tiles: Sequence[Mapping[str, AnyArray]], largest: float) -> float:
    """Read from all tiles the support ratio above which a place is weak.

    Parameters
    ----------
    tiles : sequence of mapping
        Gives ``histogram`` of every tile.
    largest : float
        Support ratio that no place may pass.
    """
    histogram = np.sum([arrays["histogram"] for arrays in tiles], axis=0)
    return support_threshold(histogram, largest=largest)


def edge_rules(
    tiles: Sequence[Mapping[str, AnyArray]],
    grid: Occupancy,
    *,
    threshold: float,
    largest: float,
    spacing_m: float,
) -> tuple[EdgeRule, EdgeRule]:
    """Read from all tiles where the surface ends, and where the one that the base is made from.

    Parameters
    ----------
    tiles : sequence of mapping
        Gives ``raster-cells`` and ``raster-spacing`` of every tile.
    grid : Occupancy
        The scene's raster; where it begins and how wide its cells are.
    threshold, largest, spacing_m : float
        As in :class:`~terraport_pipeline.geometry.clouds.edges.EdgeRule`.
    """
    cells = np.concatenate([np.zeros((0, 2), np.int32), *(each["raster-cells"] for each in tiles)])
    outline = wide = None
    if len(cells):
        raster = window_of(grid, cells.min(axis=0), cells.max(axis=0))
        for arrays in tiles:
            row, column = (arrays["raster-cells"] - np.array(raster.first)).T
            np.maximum.at(raster.spacing_m, (row, column), arrays["raster-spacing"])
        outline = make_footprint(raster)
        # One radius for all: disks this wide that grow with the local spacing would be drawn in by
        # another length than they reach out by, several spacings too far where thin meets dense.
        even_m = np.where(raster.spacing_m > 0, np.float32(spacing_m), np.float32(0.0))
        wide = make_footprint(replace(raster, spacing_m=even_m), closing_spacings=BASE_GAP_SPACINGS)
    rule = EdgeRule(threshold, largest, spacing_m, outline)
    return rule, replace(
        rule,
        largest=max(largest, BASE_GAP_SPACINGS),
        footprint=wide,
        outward_m=HEM_SPACINGS * spacing_m,
    )
