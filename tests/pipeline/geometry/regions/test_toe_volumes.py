"""Volumes above and below a region's toe, against shapes whose volume is known."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.regions.toe_volumes import toe_volumes

LINE = np.arange(-60.0, 60.5, 0.5)
X, Y = np.meshgrid(LINE, LINE)
ROUND = np.hypot(X, Y)
CONE_M3 = np.pi * 40.0**2 * 20.0 / 3.0
"""Of a cone 20 m high over a circle of 40 m radius."""


def cone(ground: np.ndarray) -> np.ndarray:
    return ground + np.maximum(20.0 - ROUND / 2, 0.0)


REGION = np.where(ROUND < 40.0, 2, 0)


@pytest.mark.parametrize("ground", [np.zeros_like(X), 0.3 * X - 0.1 * Y], ids=["flat", "slope"])
def test_a_pile_on_flat_and_sloping_ground(ground: np.ndarray) -> None:
    volume = toe_volumes(cone(ground), REGION, 0.5, [2])[2]
    assert volume.above_m3 == pytest.approx(CONE_M3, rel=0.01)
    assert volume.below_m3 < 0.001 * CONE_M3


def test_a_pit_lies_below() -> None:
    volume = toe_volumes(-cone(np.zeros_like(X)), REGION, 0.5, [2])[2]
    assert volume.below_m3 == pytest.approx(CONE_M3, rel=0.01)
    assert volume.above_m3 < 0.001 * CONE_M3


def test_inner_borders_are_toe_too() -> None:
    """A ring around a pile spans between both circles: it is flat, and the pile not its own."""
    ring = np.where((ROUND > 40.0) & (ROUND < 55.0), 3, 0)
    volume = toe_volumes(cone(np.zeros_like(X)), ring, 0.5, [3])[3]
    assert volume.above_m3 + volume.below_m3 < 0.01 * CONE_M3


def test_the_number_stands_in_the_middle() -> None:
    row, column = toe_volumes(cone(np.zeros_like(X)), REGION, 0.5, [2])[2].middle
    middle = (len(LINE) - 1) / 2
    assert abs(row - middle) < 6
    assert abs(column - middle) < 6


def test_holes_specks_lines_and_strangers_are_left_out() -> None:
    heights = cone(np.zeros_like(X))
    region = np.zeros(X.shape, int)
    region[3, 3] = 1
    region[10, :] = 4
    heights[100:, :] = np.nan
    region[200:220, 20:60] = 5
    volumes = toe_volumes(heights, region, 0.5, [1, 4, 5, 9, -1])
    assert set(volumes) <= {4}
    assert all(np.isfinite(volume.above_m3) for volume in volumes.values())


def test_at_the_rim_of_the_raster_the_region_is_its_own_toe() -> None:
    volume = toe_volumes(np.full((40, 40), 7.0), np.zeros((40, 40), int), 1.0, [0])[0]
    assert (volume.above_m3, volume.below_m3) == pytest.approx((0.0, 0.0), abs=1e-9)
