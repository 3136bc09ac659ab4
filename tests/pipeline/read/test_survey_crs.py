from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer

from terraport_pipeline.engines.readers.survey_crs import to_metres
from terraport_pipeline.errors import ReadError

UTM = np.array([[641_200.0, 8_594_700.0, 1_287.0], [641_300.0, 8_594_800.0, 1_250.0]])
PATH = Path("survey.laz")


def test_metres_pass_untouched() -> None:
    points, crs, warnings = to_metres(PATH, UTM, CRS.from_epsg(32735))
    assert points is UTM
    assert crs is not None
    assert crs.epsg == 32735
    assert CRS.from_wkt(crs.wkt) == CRS.from_epsg(32735)
    assert warnings == []


@pytest.mark.parametrize(("epsg", "unit"), [(2229, 1200 / 3937), (2992, 0.3048)])
def test_feet_become_metres_in_the_same_projection(epsg: int, unit: float) -> None:
    feet = np.array([[6_500_000.0, 1_900_000.0, 500.0], [6_500_100.0, 1_900_050.0, 510.0]])
    before = feet.copy()
    points, crs, warnings = to_metres(PATH, feet, CRS.from_epsg(epsg))
    np.testing.assert_allclose(points, feet * unit, rtol=1e-9)
    np.testing.assert_array_equal(feet, before)
    assert "converted to metres" in warnings[0]
    # The new CRS means the same place on Earth.
    assert crs is not None
    assert crs.epsg is None
    from_feet = Transformer.from_crs(CRS.from_epsg(epsg), 4326, always_xy=True)
    from_metres = Transformer.from_crs(CRS.from_wkt(crs.wkt), 4326, always_xy=True)
    np.testing.assert_allclose(
        from_metres.transform(points[:, 0], points[:, 1]),
        from_feet.transform(feet[:, 0], feet[:, 1]),
        rtol=0, atol=1e-9,
    )  # fmt: skip


def test_heights_follow_their_own_unit() -> None:
    compound = CRS("EPSG:26910+6360")  # UTM metres, heights in US survey feet
    points, _, warnings = to_metres(PATH, UTM, compound)
    np.testing.assert_array_equal(points[:, :2], UTM[:, :2])
    np.testing.assert_allclose(points[:, 2], UTM[:, 2] * 1200 / 3937)
    assert len(warnings) == 1


def test_degrees_are_refused() -> None:
    degrees = np.array([[28.3, -12.7, 1287.0], [28.31, -12.69, 1250.0]])
    with pytest.raises(ReadError, match="coordinates are degrees") as caught:
        to_metres(PATH, degrees, CRS.from_epsg(4326))
    assert "UTM" in caught.value.advice


def test_degrees_that_cannot_be_are_not_believed() -> None:
    points, crs, warnings = to_metres(PATH, UTM, CRS.from_epsg(4326))
    assert points is UTM
    assert crs is None
    assert "cannot be that" in warnings[0]


def test_earth_centred_is_refused_or_not_believed() -> None:
    centre = np.array([[5_480_000.0, 2_950_000.0, -1_390_000.0]] * 2)
    with pytest.raises(ReadError, match="Earth-centred"):
        to_metres(PATH, centre, CRS.from_epsg(4978))
    _, crs, warnings = to_metres(PATH, UTM, CRS.from_epsg(4978))
    assert crs is None
    assert len(warnings) == 1


def test_suspicion_of_degrees_without_a_crs() -> None:
    degrees = np.array([[28.300, -12.700, 1287.0], [28.303, -12.697, 1250.0]])
    assert "look like degrees" in to_metres(PATH, degrees, None)[2][0]
    bunny = np.array([[-0.09, 0.03, -0.06], [0.06, 0.18, 0.06]])
    assert to_metres(PATH, bunny, None) == (bunny, None, [])
