from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer

from terraport_pipeline.engines.readers.survey_crs import conversion_line, interpret_coordinates
from terraport_pipeline.errors import OptionError, ReadError
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import SurveyUnits

UTM = np.array([[641_200.0, 8_594_700.0, 1_287.0], [641_300.0, 8_594_800.0, 1_250.0]])
PATH = Path("survey.laz")


def to_metres(path: Path, points: np.ndarray, system: CRS | None, **stated: str):
    statement = SurveyStatement(**stated)
    low, high = points.min(axis=0), points.max(axis=0)
    units, metric, warnings = interpret_coordinates(path, low, high, system, statement)
    return (points if units is None else units.to_metres(points)), metric, warnings


def at(x: float, y: float, epsg: int | None = None, **stated: str):
    points = np.array([[x, y, 100.0], [x + 300.0, y + 300.0, 150.0]])
    return to_metres(PATH, points, None if epsg is None else CRS.from_epsg(epsg), **stated)


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
    points, crs, _ = to_metres(PATH, feet, CRS.from_epsg(epsg))
    np.testing.assert_allclose(points, feet * unit, rtol=1e-9)
    np.testing.assert_array_equal(feet, before)
    # The new CRS means the same place on Earth.
    assert crs is not None
    assert crs.epsg in (None, 26945, 2991)  # the same plane in metres
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
    assert warnings == []


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


def test_degrees_without_a_crs_are_refused_unless_a_unit_is_stated() -> None:
    degrees = np.array([[28.300, -12.700, 1287.0], [28.303, -12.697, 1250.0]])
    with pytest.raises(ReadError, match="look like degrees") as caught:
        to_metres(PATH, degrees, None)
    assert "--units m" in caught.value.advice
    assert to_metres(PATH, degrees, None, units="m")[0] is degrees
    bunny = np.array([[-0.09, 0.03, -0.06], [0.06, 0.18, 0.06]])
    assert to_metres(PATH, bunny, None) == (bunny, None, [])


FEET = 1 / 0.3048


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (984_000, 200_000),  # New York Long Island, ftUS
        (6_500_000, 1_900_000),  # California zone 5, ftUS
        (480_000 * FEET, 2_210_000 * FEET),  # UTM in feet
        (3_100_000, 10_000_000),  # Texas central, ftUS
    ],
)
def test_feet_without_a_crs_are_refused_unless_a_unit_is_stated(x: float, y: float) -> None:
    with pytest.raises(ReadError, match="look like feet") as caught:
        at(x, y)
    assert "--units us-ft" in caught.value.advice
    points, crs, warnings = at(x, y, units="us-ft")
    assert points[0, 0] == pytest.approx(x * 1200 / 3937)
    assert crs is None
    assert all("lie" not in text for text in warnings)


def test_a_unit_other_than_that_of_the_crs_is_warned_of() -> None:
    assert (
        "UTM zone 14N has units of 1 m; coordinates are taken to be in units of 0.3048 m"
        in " ".join(at(480_000 / 0.3048, 2_210_000 / 0.3048, 32614, units="ft")[2])
    )
    assert at(480_000, 2_210_000, 32614, units="m", height_units="ft")[2] == []


def test_the_conversion_says_the_units_and_who_stated_them() -> None:
    system, statement = CRS.from_epsg(2229), SurveyStatement(crs="EPSG:2277")
    feet = SurveyUnits(horizontal_m=1200 / 3937, height_m=1200 / 3937)
    assert conversion_line(feet, system, None).startswith(
        "The survey is not in metres (NAD83 / California zone 5 (ftUS): horizontal unit 0.304800"
    )
    assert "Texas Central" in conversion_line(feet, system, statement)
    assert "(as stated: " in conversion_line(feet, None, SurveyStatement(units="us-ft"))


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (480_000, 2_210_000),  # UTM
        (641_200, 8_594_700),
        (652_000, 6_862_000),  # Lambert-93
        (2_600_000, 1_200_000),  # LV95
        (4_468_000, 5_334_000),  # Gauss-Krueger
        (39_500_000, 4_400_000),  # CGCS2000
        (1_750_000, 5_420_000),  # NZTM
        (30_000, 180_000),  # a plane of Japan
    ],
)
def test_metres_of_usual_grids_need_no_statement(x: float, y: float) -> None:
    points, crs, [warning] = at(x, y)
    assert points[0].tolist() == [x, y, 100.0]
    assert crs is None
    assert "taken as metres" in warning
    assert "--units us-ft" in warning


def test_a_local_frame_is_metres_without_a_word() -> None:
    assert at(-20, 35)[2] == []
    assert at(10, 20, 32614)[2] == []


def test_a_stated_crs_overrules_the_files() -> None:
    _, crs, warnings = at(480_000, 2_210_000, 32613, crs="EPSG:32614")
    assert crs is not None
    assert crs.epsg == 32614
    assert warnings[0].startswith("The files state WGS 84 / UTM zone 13N; the survey is taken")
    # A survey that states degrees, wrongly.
    assert at(480_000, 2_210_000, 4326, crs="EPSG:32614")[1] == crs


def test_feet_of_a_stated_crs_become_metres() -> None:
    points, crs, _ = at(984_000, 200_000, crs="EPSG:2263")
    assert points[0] == pytest.approx(np.array([984_000, 200_000, 100]) * 1200 / 3937)
    assert crs is not None
    assert "Long Island" in crs.name


def test_units_overrule_the_crs_and_heights_have_their_own() -> None:
    points, crs, _ = at(480_000 * FEET, 2_210_000 * FEET, 32614, units="ft")
    assert points[0] == pytest.approx([480_000, 2_210_000, 30.48])
    assert crs is not None
    assert "UTM zone 14N" in crs.name
    points, _, _ = at(480_000, 2_210_000, 32614, height_units="us-ft")
    assert points[0] == pytest.approx([480_000, 2_210_000, 100 * 1200 / 3937])


@pytest.mark.parametrize(
    ("x", "y", "crs", "reason", "advice"),
    [
        (2_210_000, 480_000, 32614, "with x and y swapped", "--columns y,x,z"),
        (480_000 * FEET, 2_210_000 * FEET, 32614, "within it in us-ft", "--units us-ft"),
        (984_000 * 0.3048, 200_000 * 0.3048, 2263, "within it in m", "--units m"),
        (-8_240_000, 4_970_000, 3857, "are 1.3", "reproject it"),
        (1_160_300, 601_250, 5514, "read as southing and westing they are inside", "EPSG:5513"),
        (1_160_300, 601_250, 5221, "read as southing and westing they are inside", "EPSG:5513"),
    ],
)
def test_coordinates_that_contradict_their_crs_are_refused(
    x: float, y: float, crs: int, reason: str, advice: str
) -> None:
    with pytest.raises(ReadError, match=reason) as caught:
        at(x, y, crs)
    assert advice in caught.value.advice


def test_web_mercator_goes_with_a_stated_unit() -> None:
    assert at(-8_240_000, 4_970_000, 3857, units="m")[2] == []


def test_coordinates_elsewhere_on_earth_are_told() -> None:
    [warning] = at(480_000, -3_000_000, 32614)[2]
    assert "outside the area that WGS 84 / UTM zone 14N is made for" in warning


def test_statements_that_cannot_be_are_refused() -> None:
    for crs, message in (
        ("EPSG:999999", "expected one that PROJ knows"),
        ("EPSG:4326", "has degrees"),
        ("EPSG:4978", "has Earth-centred"),
    ):
        with pytest.raises(OptionError, match=message):
            SurveyStatement(crs=crs)
    with pytest.raises(OptionError, match="y stands twice"):
        SurveyStatement(columns=("x", "y", "Y", "z"))
