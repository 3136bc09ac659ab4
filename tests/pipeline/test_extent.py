"""The rectangle that a scene is built from: which values it takes, which points it holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.extent import Extent


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ((math.nan, 0, 1, 1), "extent nan 0 1 1; expected four finite numbers XMIN YMIN XMAX YMAX"),
        ((0, 0, math.inf, 1), "extent 0 0 inf 1; expected four finite numbers"),
        ((5, 0, 1, 1), "extent 5 0 1 1: XMIN 5 is not below XMAX 1; expected XMIN YMIN XMAX YMAX"),
        ((0, 1, 1, 1), "extent 0 1 1 1: YMIN 1 is not below YMAX 1"),
    ],
)
def test_values_that_are_no_rectangle_are_refused(values: tuple[float, ...], told: str) -> None:
    with pytest.raises(OptionError, match=told):
        Extent(*values)


def test_points_on_the_edges_are_within_and_those_without_a_position_are_not() -> None:
    extent = Extent(-2, 10, 3.5, 20)
    points = np.array([
        [-2.0, 10.0, 0.0],  # corners
        [3.5, 20.0, math.nan],  # its height does not matter
        [np.nextafter(3.5, 9), 15.0, 0.0],
        [0.0, np.nextafter(10.0, 0), 0.0],
        [math.nan, 15.0, 0.0],
        [math.inf, 15.0, 0.0],
    ])  # fmt: skip
    points.setflags(write=False)
    assert extent.holds(points).tolist() == [True, True, False, False, False, False]


def test_one_rectangle_is_written_in_one_way() -> None:
    assert Extent(-0.0, 0, 1, 1) == Extent(0, 0, 1, 1)
    assert repr(Extent(-0.0, 0, 1, 1)) == repr(Extent(0, 0, 1, 1))
    assert str(Extent(641200.25, 8594700, 641300, 8594800)) == "641200.25 8594700 641300 8594800"


def test_boxes_touch_clip_and_share() -> None:
    extent = Extent(0, 0, 10, 10)
    assert extent.touches((10, 10, 0), (20, 20, 0))
    assert not extent.touches((10.1, 0, 0), (20, 20, 0))
    assert extent.touches((10.1, 0, 0), (20, 20, 0), margin=0.1)
    assert extent.clipped((5, -5, 1), (15, 5, 2)) == ((5, 0, 1), (10, 5, 2))
    assert extent.clipped((20, 0, 1), (30, 5, 2)) == ((10, 0, 1), (10, 5, 2))
    assert extent.share((5, -5, 1), (15, 5, 2)) == pytest.approx(0.25)
    assert extent.share((20, 0, 1), (30, 5, 2)) == 0
    assert extent.share((5, 5, 1), (5, 5, 2)) == 1
