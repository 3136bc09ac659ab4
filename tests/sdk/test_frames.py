"""CRS and scene coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport.frames import to_crs, to_scene
from terraport_pipeline import model

COORDINATE = st.floats(-1e7, 1e7)


@given(
    point=st.tuples(COORDINATE, COORDINATE, COORDINATE),
    origin=st.tuples(COORDINATE, COORDINATE, COORDINATE),
)
def test_it_is_the_pipelines_frame_and_comes_back(point, origin) -> None:
    """The same axes as the build used; there and back within float64's rounding."""
    in_scene = to_scene(point, origin)
    built = model.to_scene(np.array([point]), np.array(origin))[0]
    np.testing.assert_array_equal(np.float32(in_scene), built)
    np.testing.assert_allclose(to_crs(in_scene, origin), point, rtol=0, atol=1e-8)


def test_a_survey_in_feet_keeps_its_own_coordinates() -> None:
    units = {"horizontal_m": 1200 / 3937, "height_m": 0.3048}
    origin, feet = (300_000.0, 60_000.0, 30.0), (984_250.0, 196_850.0, 100.0)
    assert to_scene(feet, origin, units) == pytest.approx((0.0, 0.48, 0.0), abs=1e-9)
    assert to_crs(to_scene(feet, origin, units), origin, units) == pytest.approx(feet)
