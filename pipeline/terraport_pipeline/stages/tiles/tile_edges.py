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
from terraport_pipeline.geometry.clouds.footprint import Occupancy, make_footprint
from terraport_pipeline.geometry.clouds.support import support_threshold

__all__ = ["BASE_GAP_SPACINGS", "HEM_SPACINGS", "edge_rules"]

HEM_SPACINGS: Final = 1.5
"""How far the base reaches beyond the detail, in the cloud's spacings: thinning moves a border by
less than one (99.9th percentile), and the hem is hidden where detail is shown."""

BASE_GAP_SPACINGS: Final = 12.0
"""Gaps that nowhere lie farther than this from a sample stay closed in the base: the detail shows
the holes of a thinly sampled wall when one stands before it, but from afar nobody should look
through the wall. (Without this the base of a quarry's highwall had holes of several metres.)"""


def edge_rules(
    tiles: Sequence[Mapping[str, AnyArray]],
    raster: Occupancy,
    *,
    largest: float,
    spacing_m: float,
) -> tuple[EdgeRule, EdgeRule]:
    """Read from all tiles where the surface ends, and where the one that the base is made from.

    Parameters
    ----------
    tiles : sequence of mapping
        Gives ``histogram``, ``raster-cells`` and ``raster-spacing`` of every tile.
    raster : Occupancy
        Empty; filled here.
    largest, spacing_m : float
        As in :class:`~terraport_pipeline.geometry.clouds.edges.EdgeRule`.
    """
    for arrays in tiles:
        cells = arrays["raster-cells"]
        np.maximum.at(raster.spacing_m.reshape(-1), cells, arrays["raster-spacing"])
    histogram = np.sum([arrays["histogram"] for arrays in tiles], axis=0)
    threshold = support_threshold(histogram, largest=largest)
    outline = wide = None
    if raster.spacing_m.any():
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
