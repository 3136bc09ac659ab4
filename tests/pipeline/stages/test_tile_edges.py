"""Where a surface in tiles ends, read from all of them."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.clouds.footprint import Occupancy
from terraport_pipeline.geometry.clouds.support import BINS
from terraport_pipeline.stages.tiles.tile_edges import edge_rules


def test_where_the_surface_ends_is_read_from_all_tiles() -> None:
    # the mode below one spacing lies in one tile, the plateau in the other
    mode, plateau = np.zeros(BINS), np.zeros(BINS)
    mode[: BINS // 10] = 100.0
    plateau[:] = 1.0
    nothing = {"raster-cells": np.zeros(0, np.int64), "raster-spacing": np.zeros(0, np.float32)}
    full = {
        "raster-cells": np.arange(400, dtype=np.int64),
        "raster-spacing": np.full(400, 0.5, np.float32),
    }

    def raster() -> Occupancy:
        return Occupancy((0.0, 0.0), 0.5, 0.5, np.zeros((20, 20), np.float32))

    tiles = [{"histogram": mode, **nothing}, {"histogram": plateau, **full}]
    rule, base_rule = edge_rules(tiles, raster(), largest=4.0, spacing_m=0.5)
    whole, _ = edge_rules(
        [{"histogram": mode + plateau, **full}], raster(), largest=4.0, spacing_m=0.5
    )
    assert rule.threshold == whole.threshold
    assert 2.0 <= rule.threshold <= 4.0
    assert rule.footprint is not None
    assert rule.footprint.margin_m(np.array([[5.0, 0.0, 5.0]], np.float32))[0] > 0
    # what the base is made from goes farther out, and its outline holds the surface's
    assert base_rule.threshold == rule.threshold
    assert base_rule.largest > rule.largest
    assert base_rule.outward_m > 0.0 == rule.outward_m
    assert base_rule.footprint is not None
    bare, _ = edge_rules([{"histogram": mode, **nothing}], raster(), largest=4.0, spacing_m=0.5)
    assert bare.footprint is None
