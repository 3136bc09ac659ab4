"""What a tile sees of a change: nothing beyond its own walls."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.clouds.change_raster import ChangeRaster
from terraport_pipeline.geometry.clouds.height_changes import HeightChanges
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages.survey_change import TileHeights, clashing_attribute

LATTICE = Lattice((-8.0, -4.0, 100.0), 0.25)
"""Blocks of 4 m, columns of 1 m."""


def sunk(earlier: HeightChanges, *blocks: tuple[int, int, int], by_m: float) -> HeightChanges:
    dz_m = np.full((16, 16), -by_m, np.float32)
    raster = ChangeRaster((0.0, 0.0), 1.0, 1.0, dz_m, dz_m, np.ones((16, 16), np.bool_), (0, 0))
    return earlier.renewed(raster, 1, np.array(blocks, np.int64))


def tile(heights: HeightChanges, low: tuple, high: tuple) -> TileHeights:
    """A tile with vertices in all of its walls, metres about the lattice's corner."""
    anchor = np.array(LATTICE.anchor_m)
    box = np.concatenate([anchor + low, anchor + high])
    return TileHeights.of(heights, LATTICE, 16, box.astype(np.float32).astype(np.float64))


def at(heights: TileHeights, *places: tuple[float, float, float]) -> list[float]:
    return heights.at((np.array(places) + LATTICE.anchor_m).astype(np.float32)).tolist()


def test_a_tile_beside_the_change_is_as_it_was() -> None:
    first = sunk(HeightChanges.none(4), (0, 0, 0), by_m=1.0)
    then = sunk(first, (1, 0, 0), (0, 1, 0), (0, 0, 1), by_m=3.0)
    before, after = (tile(table, (0, 0, 0), (4, 4, 4)) for table in (first, then))
    assert before.digest == after.digest
    places = [(0.0, 0.0, 0.0), (4.0, 4.0, 4.0), (3.99, 2.0, 2.0), (2.0, 3.99, 4.0)]
    assert at(before, *places) == at(after, *places) == [-1.0] * 4
    assert tile(HeightChanges.none(4), (0, 0, 0), (4, 4, 4)).digest is None


def test_vertices_in_a_wall_have_what_lies_on_their_own_side() -> None:
    heights = sunk(HeightChanges.none(4), (1, 0, 0), by_m=2.0)
    west, east = tile(heights, (0, 0, 0), (4, 4, 4)), tile(heights, (4, 0, 0), (8, 4, 4))
    assert west.digest is None
    assert np.isnan(at(west, (4.0, 2.0, 2.0))).all()
    assert at(east, (4.0, 2.0, 2.0), (8.0, 2.0, 2.0)) == [-2.0, -2.0]


def test_a_flat_tile_sees_its_change() -> None:
    heights = sunk(HeightChanges.none(4), (0, 0, 0), by_m=2.0)
    assert at(tile(heights, (0, 1, 0), (4, 1, 4)), (2.0, 1.0, 2.0)) == [-2.0]


def test_an_attribute_that_would_stand_in_its_place() -> None:
    assert clashing_attribute(["grade", "Height change m"]) == "Height change m"
    assert clashing_attribute(["grade", "height_change"]) is None
