"""What was painted on a scene: a GeoJSON file in the survey's coordinates, bounded."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from store.tiny_scene import TinyScene

from terraport_store import DamagedSceneError, Manifest, Stroke, StrokeError, Strokes, read_manifest
from terraport_store.manifest import CrsInfo, SurveyUnits
from terraport_store.strokes import MAX_PLACES, MAX_STROKES

BODY: dict[str, Any] = {
    "name": "haul road",
    "colour": "#C08a2e",
    "width_m": 3,
    "line": [[10.0, -20.0], [11.5, -22.25]],
}


def painted(number: int = 1, who: str = "anna", **changes: Any) -> Stroke:
    return Stroke.painted(
        {**BODY, **changes}, stroke_id=f"{number:016x}", who=who, when="2026-11-24T09:12:07Z"
    )


@pytest.fixture
def manifest(tiny: TinyScene) -> Manifest:
    return read_manifest(tiny.path).model_copy(
        update={"origin": (500_000.0, 6_000_000.0, 50.0), "crs": CrsInfo(name="U", epsg=32633)}
    )


def test_they_are_written_in_the_surveys_coordinates_and_come_back(manifest: Manifest) -> None:
    data = Strokes((painted(),)).encoded(manifest)
    document = json.loads(data)
    assert document["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32633"
    (feature,) = document["features"]
    # North is against z.
    assert feature["geometry"] == {
        "type": "LineString",
        "coordinates": [[500_010.0, 6_000_020.0], [500_011.5, 6_000_022.25]],
    }
    assert feature["properties"]["name"] == "haul road"
    back = Strokes.parsed(data, manifest)
    assert back.strokes == (painted(),)
    assert back.strokes[0].colour == "#c08a2e"
    assert len(back.revision) == 16


def test_a_scene_in_feet_without_a_crs_has_them_in_feet(manifest: Manifest) -> None:
    units = SurveyUnits(horizontal_m=0.3048, height_m=0.3048)
    in_feet = manifest.model_copy(
        update={"crs": None, "survey_units": units, "origin": (3.048, 0.0, 0.0)}
    )
    data = Strokes((painted(),)).encoded(in_feet)
    assert "crs" not in json.loads(data)
    east, north = json.loads(data)["features"][0]["geometry"]["coordinates"][0]
    assert east == pytest.approx(13.048 / 0.3048, abs=1e-3)
    assert north == pytest.approx(20.0 / 0.3048, abs=1e-3)
    assert Strokes.parsed(data, in_feet).strokes[0].line[0] == pytest.approx((10, -20), abs=1e-3)


def test_what_somebody_drew_in_a_gis_is_kept(manifest: Manifest) -> None:
    drawn = {
        "type": "Feature",
        "properties": {"name": "bench"},
        "geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 1]]},
    }
    point = {"type": "Feature", "properties": None, "geometry": None}
    twice = json.loads(Strokes((painted(), replace(painted(), who="ben"))).encoded(manifest))
    text = json.dumps({"type": "FeatureCollection", "features": [drawn, point, *twice["features"]]})
    strokes = Strokes.parsed(text.encode(), manifest)
    assert [one.who for one in strokes.strokes] == ["anna"], "an id twice is no second stroke"
    again = Strokes.parsed(strokes.encoded(manifest), manifest)
    assert again.strokes == strokes.strokes
    assert again.others == strokes.others == (drawn, point, twice["features"][1])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"name": ""}, "name: an empty label"),
        ({"name": "a\nb"}, "name: a label with the control character"),
        ({"name": 7}, "a wrong name, colour or width_m"),
        ({"colour": "red"}, "colour 'red', expected # and six"),
        ({"width_m": 0.01}, "width_m 0.01, expected 0.05 to 100"),
        ({"width_m": True}, "a wrong name, colour or width_m"),
        ({"width_m": float("nan")}, "a wrong name, colour or width_m"),
        ({"line": [[0, 0]]}, "line of 1 places, expected 2 to 256"),
        ({"line": [[0, 0]] * (MAX_PLACES + 1)}, "a wrong line, expected a list of 2 to 256"),
        ({"line": [[0, 0], [1]]}, "a wrong place in the line"),
        ({"line": [[0, 0], [float("inf"), 1]]}, "a wrong place in the line"),
        ({"line": [[0, 0], [2e7, 1]]}, "line leaves the scene"),
    ],
)
def test_what_is_no_stroke_is_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(StrokeError, match=text):
        painted(**changes)


@pytest.mark.parametrize("body", [None, [], "stroke", 3])
def test_a_body_is_an_object(body: object) -> None:
    with pytest.raises(StrokeError, match="expected an object"):
        Stroke.painted(body, stroke_id="0" * 16, who="a", when="2026-11-24T09:12:07Z")


def test_there_is_an_end_to_them(manifest: Manifest) -> None:
    full = Strokes(tuple(painted(n) for n in range(MAX_STROKES)))
    with pytest.raises(StrokeError, match="2,000 strokes are there") as caught:
        full.with_one(painted(MAX_STROKES))
    assert caught.value.is_full
    drawn = {"type": "Feature", "properties": {"name": "x" * (16 << 20)}, "geometry": None}
    with pytest.raises(StrokeError, match="bytes of strokes, expected at most 16,777,216"):
        Strokes(others=(drawn,)).encoded(manifest)


@pytest.mark.parametrize("data", [b"", b"[]", b'{"features": 3}', b"{" * 100_000])
def test_a_damaged_file_is_named(data: bytes, manifest: Manifest) -> None:
    with pytest.raises(DamagedSceneError, match=r"strokes\.geojson"):
        Strokes.parsed(data, manifest)
