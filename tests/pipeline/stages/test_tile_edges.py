"""Where a surface in tiles ends, read from all of them."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Occupancy
from terraport_pipeline.geometry.clouds.support import BINS
from terraport_pipeline.stages.tiles.tile_edges import edge_rules, end_of_support


def test_where_the_surface_ends_is_read_from_all_tiles() -> None:
    # the mode below one spacing lies in one tile, the plateau in the other
    mode, plateau = np.zeros(BINS), np.zeros(BINS)
    mode[: BINS // 10] = 100.0
    plateau[:] = 1.0
    nothing = {
        "raster-cells": np.zeros((0, 2), np.int32),
        "raster-spacing": np.zeros(0, np.float32),
    }
    full = {
        "raster-cells": np.stack(np.divmod(np.arange(400, dtype=np.int32), 20), axis=1),
        "raster-spacing": np.full(400, 0.5, np.float32),
    }

    grid = Occupancy((0.0, 0.0), 0.5, 0.5, np.zeros((0, 0), np.float32))
    tiles = [{"histogram": mode, **nothing}, {"histogram": plateau, **full}]
    threshold = end_of_support(tiles, 4.0)
    assert threshold == end_of_support([{"histogram": mode + plateau}], 4.0)
    assert 2.0 <= threshold <= 4.0
    rule, base_rule = edge_rules(tiles, grid, threshold=threshold, largest=4.0, spacing_m=0.5)
    assert rule.threshold == threshold
    assert rule.footprint is not None
    assert rule.footprint.margin_m(np.array([[5.0, 0.0, 5.0]], np.float32))[0] > 0
    # what the base is made from goes farther out, and its outline holds the surface's
    assert base_rule.threshold == rule.threshold
    assert base_rule.largest > rule.largest
    assert base_rule.outward_m > 0.0 == rule.outward_m
    assert base_rule.footprint is not None
    bare, _ = edge_rules(tiles[:1], grid, threshold=threshold, largest=4.0, spacing_m=0.5)
    assert bare.footprint is None


def test_a_tiles_rule_depends_on_the_outline_near_it_alone() -> None:
    grid = Occupancy((0.0, 0.0), 0.5, 0.5, np.zeros((0, 0), np.float32))

    def rule(east: int) -> EdgeRule:
        cells = np.stack(np.meshgrid(np.arange(200), np.arange(east)), axis=-1).reshape(-1, 2)
        tile = {
            "raster-cells": cells[:, ::-1].astype(np.int32),
            "raster-spacing": np.full(len(cells), 0.5, np.float32),
        }
        return edge_rules([tile], grid, threshold=2.0, largest=4.0, spacing_m=0.5)[0]

    rng = np.random.default_rng(1)
    points = rng.uniform([0, 0, 20], [50, 5, 70], (5000, 3)).astype(np.float32)
    low_m, high_m = np.array([0.0, 0.0, 20.0]), np.array([50.0, 5.0, 70.0])
    whole, wider = rule(200), rule(260)
    assert whole.footprint is not None
    assert wider.footprint is not None
    window, other = (each.within(low_m, high_m).footprint for each in (whole, wider))
    assert window is not None
    assert other is not None
    assert window.first == other.first
    assert (window.field_m == other.field_m).all()
    # What no support ratio can reach is cut down, everything else is bit by bit what it was.
    most_m = np.float32(4.0 * 0.5)
    before, after = whole.footprint.margin_m(points), window.margin_m(points)
    assert (before < most_m).any()
    assert (np.minimum(before, most_m) == np.minimum(after, most_m)).all()
