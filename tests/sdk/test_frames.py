"""CRS and scene coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import terraport
from terraport.frames import to_crs, to_scene
from terraport_payload import SegmentMesh
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


def test_arrays_of_any_type_are_converted_in_float64() -> None:
    origin = (500_000.0, 8_000_000.0, 100.0)
    rows = np.float32([[10.125, 30.5, -20.25], [0.0, -1.5, 7.0]])
    true = [[500_010.125, 8_000_020.25, 130.5], [500_000.0, 7_999_993.0, 98.5]]
    found = to_crs(rows, origin)
    assert found.dtype == np.float64
    assert found.tolist() == true
    assert to_scene(found, origin).tolist() == rows.tolist()
    assert to_crs(rows[0], origin) == tuple(true[0])
    with pytest.raises(ValueError, match=r"got positions of shape \(2, 2\), expected"):
        to_crs(np.zeros((2, 2)), origin)


def test_axes_to_the_south_west_and_down_are_the_surveys() -> None:
    units = {"horizontal_m": 0.5, "height_m": 2.0, "axes": ["south", "west", "down"]}
    origin = (-700_000.0, -1_100_000.0, 10.0)
    # 4 m east, 6 m up and 8 m south of the origin.
    assert to_crs((4.0, 6.0, 8.0), origin, units) == (2_200_016.0, 1_399_992.0, -8.0)
    assert to_scene((2_200_016.0, 1_399_992.0, -8.0), origin, units) == (4.0, 6.0, 8.0)


def test_the_vertices_of_a_mesh_are_coordinates_of_the_survey() -> None:
    mesh = SegmentMesh(
        np.float32([[1, 2, 3], [4, 5, 6.0625]]), np.zeros((0, 3), np.uint32), np.zeros((2, 3))
    )
    manifest = {"origin": [641_200.0, 8_594_700.0, 1287.0], "survey_units": None}
    assert terraport.crs_positions(mesh, manifest).tolist() == [
        [641_201.0, 8_594_697.0, 1289.0],
        [641_204.0, 8_594_693.9375, 1292.0],
    ]
