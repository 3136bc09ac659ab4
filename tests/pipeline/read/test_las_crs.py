"""What LAS files state of units, heights and axes, in GeoTIFF keys and well-known text."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from tests.pipeline.stated_coordinates import (
    FOOT,
    PROJECTED,
    US_FOOT,
    Keys,
    Read,
    slope,
    write_las,
)

from terraport_pipeline.errors import ReadError, SurveyError

NUMBER = itertools.count()
TEXAS = CRS.from_epsg(2278)  # US survey feet
KROVAK = (-601_250.0, -1_160_300.0, 240.0)
LO31 = (-41_820.0, -2_768_400.0, 1_530.0)


def read(tmp_path: Path, points: np.ndarray, **options: object) -> Read:
    file = {name: options.pop(name) for name in ("keys", "wkt", "wkt_bit") if name in options}
    number = next(NUMBER)
    path = write_las(tmp_path / f"{number}.las", points, **file)
    return Read(path, tmp_path / f"read-{number}", **options)


@pytest.mark.parametrize(
    ("keys", "plan_m", "height_m"),
    [
        # A grid in metres, heights in feet: by the vertical system, its unit, or the unit alone.
        ({3072: 26915, 4096: 6360, 4099: 9003}, 1.0, US_FOOT),
        ({3072: 26915, 4096: 6360}, 1.0, US_FOOT),
        ({3072: 26915, 4096: 8228}, 1.0, FOOT),
        ({3072: 26915, 4099: 9002}, 1.0, FOOT),
        ({3072: 26915, 3076: 9001, 4099: 9003}, 1.0, US_FOOT),
        ({3072: 26915, 4096: 5103, 4099: 9003}, 1.0, US_FOOT),  # a datum's code
        ({3072: 26915, 4096: 32767, 4097: "NAVD88 (ft)", 4099: 9003}, 1.0, US_FOOT),
        # A grid in feet, heights in metres, in its own feet, or in others.
        ({3072: 2278, 4096: 5703, 4099: 9001}, US_FOOT, 1.0),
        ({3072: 2278, 4096: 5703}, US_FOOT, 1.0),
        ({3072: 2278, 3076: 9003, 4099: 9001}, US_FOOT, 1.0),
        ({3072: 2278}, US_FOOT, US_FOOT),
        ({3072: 2278, 4099: 9003}, US_FOOT, US_FOOT),
        ({3072: 2278, 4099: 9002}, US_FOOT, FOOT),
        ({3072: 2994, 4096: 5703}, FOOT, 1.0),
        # All in metres.
        ({3072: 26915, 4096: 5703, 4099: 9001}, 1.0, 1.0),
        ({3072: 26915, 4096: 5103}, 1.0, 1.0),
        # Systems of the user's own.
        ({3072: 32767, 3076: 9003, 4099: 9003}, US_FOOT, US_FOOT),
        ({3072: 32767, 1026: "Grübe S", 3076: 9002, 4099: 9001}, FOOT, 1.0),
        ({3072: 32767, 3074: 32767, 3075: 1, 2048: 4269, 3076: 9002}, FOOT, FOOT),
        ({3072: 32767, 3076: 32767, 3077: 0.9144}, 0.9144, 0.9144),
        ({3076: 9002}, FOOT, FOOT),
        ({3072: 32767, 3076: 1025}, 0.001, 0.001),
    ],
)
def test_units_of_the_keys_count(
    tmp_path: Path, keys: Keys, plan_m: float, height_m: float
) -> None:
    code = keys.get(3072, 0)
    place = {26915: (420_000, 4_650_000), 2278: (900_000, 4_200_000), 2994: (300_000, 250_000)}
    true = slope(*place.get(code, (1_200, 3_400)), 250)
    found = read(tmp_path, true / [plan_m, plan_m, height_m], keys=PROJECTED | keys)
    assert found.is_at(true)
    lengths = (plan_m, height_m)
    assert (found.units is None) == (lengths == (1.0, 1.0))
    assert bool(found.choices) == (lengths != (1.0, 1.0))
    if found.units is not None:
        assert (found.units.horizontal_m, found.units.height_m) == pytest.approx(lengths, rel=1e-9)
    is_local = code in (0, 32767)
    assert any("user-defined" in text for text in found.warnings) == is_local
    assert found.crs is not None
    assert ("Grübe S" in found.crs["name"]) == (1026 in keys)
    if code == 26915:
        assert found.crs["epsg"] in (26915, None)


@pytest.mark.parametrize(
    ("keys", "reason", "option"),
    [
        ({3072: 26915, 4096: 5703, 4099: 9003}, r"EPSG:5703.* and in key 4099", "us-ft"),
        ({3072: 26915, 4096: 6360, 4099: 9001}, "units of US survey foot, and in key 4099", "m"),
        ({3072: 26915, 4099: 9999}, "key 4099 states unit 9999 for heights", "ft"),
        ({3072: 26915, 4099: 9102}, "key 4099 states unit 9102 for heights", "m"),
        ({3072: 2278, 4096: 5031}, "4096 is 5031", "m"),
    ],
)  # fmt: skip
def test_heights_that_are_stated_in_two_units_are_asked_for(
    tmp_path: Path, keys: Keys, reason: str, option: str
) -> None:
    true = slope(420_000, 4_650_000, 250) if keys[3072] == 26915 else slope(900_000, 4_200_000, 99)
    unit = US_FOOT if keys[3072] == 2278 else 1.0
    height_m = {"m": 1.0, "ft": FOOT, "us-ft": US_FOOT}[option]
    given = true / [unit, unit, height_m]
    with pytest.raises(ReadError, match=reason) as caught:
        read(tmp_path, given, keys=PROJECTED | keys)
    assert "--height-units" in str(caught.value)
    found = read(tmp_path, given, keys=PROJECTED | keys, height_units=option)
    assert found.is_at(true)


def test_a_grid_stated_in_two_units_is_asked_for(tmp_path: Path) -> None:
    true = slope(900_000, 4_200_000, 99)
    keys: Keys = {**PROJECTED, 3072: 2278, 3076: 9001}
    with pytest.raises(ReadError, match=r"EPSG:2278.*in key 3076 units of metre") as caught:
        read(tmp_path, true / US_FOOT, keys=keys)
    assert "--units m" in str(caught.value)
    assert read(tmp_path, true / US_FOOT, keys=keys, units="us-ft").is_at(true)
    assert read(tmp_path, true / US_FOOT, keys=keys, crs="EPSG:2278").is_at(true)


@pytest.mark.parametrize("keys", [{3072: 2278, 3076: 9002}, {3072: 2278, 4096: 6360, 4099: 9002}])
def test_both_kinds_of_feet_are_told_apart_by_the_code(tmp_path: Path, keys: Keys) -> None:
    true = slope(900_000, 4_200_000, 99)
    found = read(tmp_path, true / US_FOOT, keys=PROJECTED | keys)
    assert found.is_at(true)
    assert any("contradicts itself" in text for text in found.warnings)


def test_heights_in_feet_need_a_unit_of_the_plan(tmp_path: Path) -> None:
    true = slope(1_200, 3_400, 250)
    for keys in ({4099: 9003}, {1024: 2, 2048: 4269, 4099: 9003}):
        with pytest.raises(ReadError, match="no unit of x and y") as caught:
            read(tmp_path, true / US_FOOT, keys=keys)
        assert "--units" in str(caught.value)
        assert read(tmp_path, true / US_FOOT, keys=keys, units="us-ft").is_at(true)


def test_a_stated_crs_does_not_lose_heights_in_another_unit(tmp_path: Path) -> None:
    true = slope(420_000, 4_650_000, 250)
    given, keys = true / [1, 1, US_FOOT], {**PROJECTED, 3072: 26915, 4099: 9003}
    with pytest.raises(ReadError, match="does not say what z is") as caught:
        read(tmp_path, given, keys=keys, crs="EPSG:26915")
    assert "--height-units" in str(caught.value)
    assert read(tmp_path, given, keys=keys, crs="EPSG:26915", height_units="us-ft").is_at(true)
    assert read(tmp_path, given, keys=keys, crs="EPSG:26915+6360").is_at(true)


@pytest.mark.parametrize("bit", [True, False])
def test_keys_beside_a_text_count_by_the_header(tmp_path: Path, bit: bool) -> None:
    true = slope(420_000, 4_650_000, 250)
    wkt = CRS("EPSG:26915+5703").to_wkt("WKT1_GDAL")
    keys: Keys = {**PROJECTED, 3072: 26915, 4096: 6360}
    given = true if bit else true / [1, 1, US_FOOT]
    found = read(tmp_path, given, keys=keys, wkt=wkt, wkt_bit=bit)
    assert found.is_at(true)
    [warning] = [text for text in found.warnings if "Its header selects the first" in text]
    assert warning.index("well-known text") < warning.index("GeoTIFF keys") or not bit
    # Without a contradiction nothing is said, and a text without the bit is better than nothing.
    assert read(tmp_path, true, keys={**PROJECTED, 3072: 26915}, wkt=wkt).warnings == ()
    alone = read(
        tmp_path, true / [1, 1, US_FOOT], wkt=CRS("EPSG:26915+6360").to_wkt(), wkt_bit=False
    )
    assert alone.is_at(true)


def test_a_text_in_a_citation_is_read(tmp_path: Path) -> None:
    true = slope(900_000, 4_200_000, 99)
    text = "ESRI PE String = " + TEXAS.to_wkt("WKT1_ESRI")
    found = read(tmp_path, true / US_FOOT, keys={**PROJECTED, 3072: 32767, 3073: text, 3076: 9003})
    assert found.is_at(true)
    assert found.crs is not None
    assert "Texas" in found.crs["name"]


@pytest.mark.parametrize("vertical", [5715, 5336, 8051, 6358])
def test_depths_become_heights(tmp_path: Path, vertical: int) -> None:
    true = slope(420_000, 4_650_000, -60)
    unit = CRS.from_epsg(vertical).axis_info[0].unit_conversion_factor
    given = true / [1, 1, -unit]
    wkt = CRS(f"EPSG:26915+{vertical}").to_wkt("WKT1_GDAL")
    by_text = read(tmp_path, given, wkt=wkt)
    by_keys = read(tmp_path, given, keys={**PROJECTED, 3072: 26915, 4096: vertical})
    stated = read(tmp_path, given, crs=f"EPSG:26915+{vertical}")
    for found in (by_text, by_keys, stated):
        assert found.is_at(true)
        assert "z down" in found.choices[0]
        assert found.crs is not None
        assert CRS.from_wkt(found.crs["wkt"]).axis_info[2].direction == "up"
        assert found.units is not None
        assert found.units.axes == ("east", "north", "down")
        np.testing.assert_allclose(found.units.to_metres(given), true, atol=1e-6)
    with pytest.raises(ReadError, match="the files state depths"):
        read(tmp_path, given, wkt=wkt, crs="EPSG:26915")
    # Negative depths are above the datum, or heights: it is said.
    assert any("all z are negative" in text for text in read(tmp_path, true, wkt=wkt).warnings)


def reordered(true: np.ndarray, axes: str) -> np.ndarray:
    """Coordinates along other axes: ``ws`` are westing and southing."""
    east, north, height = true.T
    along = {"e": east, "n": north, "w": -east, "s": -north}
    return np.stack([along[axes[0]], along[axes[1]], height], axis=1)


@pytest.mark.parametrize(
    ("epsg", "axes", "place", "scene_epsg"),
    [
        (5513, "sw", KROVAK, 5514),
        (2065, "sw", (-601_250.0, -1_160_300.0, 240.0), 5221),
        (2054, "ws", LO31, None),
        (29377, "ws", (-12_300.0, -250_700.0, 40.0), None),
    ],
)
def test_axes_to_the_south_and_west_are_turned(
    tmp_path: Path, epsg: int, axes: str, place: tuple[float, float, float], scene_epsg
) -> None:
    system = CRS.from_epsg(epsg)
    unit = system.axis_info[0].unit_conversion_factor
    true = slope(*place)
    given = reordered(true, axes) / unit
    read_in_ways = [
        read(tmp_path, given, keys={**PROJECTED, 3072: epsg}),
        read(tmp_path, given, crs=f"EPSG:{epsg}"),
        read(tmp_path, given, wkt=system.to_wkt("WKT1_GDAL")),
        read(tmp_path, given, wkt=system.to_wkt("WKT2_2019")),
    ]
    for found in read_in_ways:
        assert found.is_at(true)
        assert found.crs is not None
        assert found.crs["epsg"] == scene_epsg
        scene = CRS.from_wkt(found.crs["wkt"])
        assert [axis.direction for axis in scene.axis_info] == ["east", "north"]
        assert found.units is not None
        np.testing.assert_allclose(found.units.from_metres(true), given, atol=1e-6)
        assert CRS.from_wkt(found.units.crs_wkt) == system
    if epsg == 29377:  # counts from within its area: numbers of either sign can be meant
        return
    # Eastings and northings under its code would be turned: refused, with the right system.
    with pytest.raises(ReadError, match="are easting and northing") as caught:
        read(tmp_path, true / unit, keys={**PROJECTED, 3072: epsg})
    assert "--crs" in caught.value.advice


@pytest.mark.parametrize(
    ("epsg", "place"),
    [
        (2180, (500_000.0, 520_000.0)),
        (3301, (540_000.0, 6_500_000.0)),
        (31467, (3_500_000.0, 5_500_000.0)),
        (2193, (1_600_000.0, 5_400_000.0)),
        (3031, (1_500_000.0, 1_450_000.0)),
        (3413, (-200_000.0, -2_300_000.0)),
        (32661, (2_100_000.0, 1_900_000.0)),
    ],
)
def test_northing_first_and_polar_systems_stay_east_and_north(
    tmp_path: Path, epsg: int, place: tuple[float, float]
) -> None:
    true, system = slope(*place, 90), CRS.from_epsg(epsg)
    for stated in (
        {"keys": {**PROJECTED, 3072: epsg}},
        {"wkt": system.to_wkt("WKT1_GDAL")},
        {"wkt": system.to_wkt("WKT2_2019")},
        {"crs": f"EPSG:{epsg}"},
    ):
        found = read(tmp_path, true, **stated)
        assert found.is_at(true)
        assert found.units is None


ENGINEERING = (
    'ENGCRS["pit",EDATUM["pit"],CS[Cartesian,{n}],AXIS["x",{x}],AXIS["y",{y}]{z},'
    'LENGTHUNIT["foot",0.3048]]'
)


def test_local_systems_have_their_axes_and_units(tmp_path: Path) -> None:
    true = slope(1_200, 3_400, 250)
    turned = ENGINEERING.format(n=2, x="south", y="west", z="")
    assert read(tmp_path, reordered(true, "sw") / FOOT, wkt=turned).is_at(true)
    deep = ENGINEERING.format(n=3, x="east", y="north", z=',AXIS["depth",down]')
    assert read(tmp_path, true / [FOOT, FOOT, -FOOT], wkt=deep).is_at(true)
    old = 'LOCAL_CS["pit",LOCAL_DATUM["pit",32767],UNIT["foot",0.3048]]'
    assert read(tmp_path, true / FOOT, wkt=old).is_at(true)
    aslant = ENGINEERING.format(n=2, x="northEast", y="southEast", z="")
    with pytest.raises(ReadError, match="axes that point northEast and southEast"):
        read(tmp_path, true, wkt=aslant)
    first = ENGINEERING.format(n=2, x="north", y="east", z="")
    assert any("lists the northing first" in t for t in read(tmp_path, true, wkt=first).warnings)


def test_a_shift_to_another_datum_does_not_hide_the_unit(tmp_path: Path) -> None:
    true = slope(900_000, 4_200_000, 99)
    authority = 'AUTHORITY["EPSG","6269"]]'
    for vertical, height_m in (("", US_FOOT), ("+5703", 1.0)):
        wkt = CRS(f"EPSG:2278{vertical}").to_wkt("WKT1_GDAL")
        shifted = wkt.replace(authority, f"TOWGS84[0,0,0,0,0,0,0],{authority}", 1)
        assert shifted != wkt
        found = read(tmp_path, true / [US_FOOT, US_FOOT, height_m], wkt=shifted)
        assert found.is_at(true)
        assert found.crs is not None
        assert CRS.from_wkt(found.crs["wkt"]).axis_info[0].unit_conversion_factor == 1.0


UTM = CRS.from_epsg(26915)


@pytest.mark.parametrize(
    "west",
    [
        {"keys": {**PROJECTED, 3072: 26915}},
        {"wkt": UTM.to_wkt("WKT1_ESRI")},
        {"wkt": UTM.to_wkt("WKT2_2019")},
        {"wkt": CRS.from_user_input("+proj=utm +zone=15 +datum=NAD83").to_wkt()},
        {"wkt": UTM.to_wkt("WKT1_GDAL").replace(
            'AUTHORITY["EPSG","6269"]]', 'TOWGS84[0,0,0,0,0,0,0],AUTHORITY["EPSG","6269"]]', 1)},
    ],
)  # fmt: skip
def test_one_grid_that_files_spell_in_two_ways_is_one_survey(tmp_path: Path, west) -> None:
    true = slope(420_000, 4_650_000, 250)
    is_west = true[:, 0] < 420_015
    for name, vertical in (("plan", ""), ("heights", "+5703")):
        files = [
            write_las(tmp_path / f"{name}-west.las", true[is_west], **west),
            write_las(
                tmp_path / f"{name}-east.las",
                true[~is_west],
                wkt=CRS(f"EPSG:26915{vertical}").to_wkt("WKT1_GDAL"),
            ),
        ]
        found = Read(files, tmp_path / f"read-{name}")
        assert found.is_at(true)
        assert found.crs is not None
        assert found.crs["epsg"] == 26915
        assert Read(files, tmp_path / f"{name}-stated", crs="EPSG:26915").is_at(true)
        said = [text for text in found.warnings if "No vertical system is stated" in text]
        assert len(said) == (1 if vertical else 0)


def test_files_whose_heights_differ_are_no_survey(tmp_path: Path) -> None:
    true = slope(420_000, 4_650_000, 250)
    is_west = true[:, 0] < 420_015
    feet = true[~is_west] / [1, 1, US_FOOT]
    files = [
        write_las(tmp_path / "west.las", true[is_west], keys={**PROJECTED, 3072: 26915}),
        write_las(tmp_path / "east.las", feet, keys={**PROJECTED, 3072: 26915, 4099: 9003}),
    ]
    with pytest.raises(SurveyError, match=r"heights in units of 0.3048006"):
        Read(files, tmp_path / "one")
    with pytest.raises(ReadError, match="does not say what z is"):
        Read(files, tmp_path / "two", crs="EPSG:26915")


def test_a_stated_crs_overrules_files_in_several(tmp_path: Path) -> None:
    true = slope(420_000, 4_650_000, 250)
    is_west = true[:, 0] < 420_015
    files = [
        write_las(tmp_path / "west.las", true[is_west], keys={**PROJECTED, 3072: 32615}),
        write_las(tmp_path / "east.las", true[~is_west], keys={**PROJECTED, 3072: 26915}),
    ]
    with pytest.raises(SurveyError, match="in 2 coordinate reference systems"):
        Read(files, tmp_path / "one")
    assert Read(files, tmp_path / "two", crs="EPSG:26915").is_at(true)


@pytest.mark.parametrize(("name", "unit"), [("mm", 0.001), ("cm", 0.01)])
def test_millimetres_and_centimetres_can_be_stated(tmp_path: Path, name: str, unit: float) -> None:
    true = slope(1_200, 3_400, 250)
    path = tmp_path / "pit.xyz"
    np.savetxt(path, true / unit, fmt="%.4f")
    found = Read(path, tmp_path / "read", units=name)
    assert found.is_at(true)
    assert found.units is not None
    assert found.units.height_m == unit
