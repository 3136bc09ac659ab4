"""Contours and cross-sections, opened by ezdxf and GDAL (pyogrio): where they are."""

from __future__ import annotations

import csv
import math

import ezdxf
import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import CRS

from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.export.section import parse_line
from terraport_pipeline.export.vector_file import write_shapes
from terraport_pipeline.extent import Extent

EAST, NORTH, HEIGHT = 500_000.0, 6_000_000.0, 120.0
CHORD_M = 0.03
BOX = Extent(EAST + 20, NORTH - 60, EAST + 60, NORTH - 30)
LINE = "500010,5999990 500070.5,5999950 500070.5,5999905"


def truth(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    x, z = east - EAST, NORTH - north
    bench = 6.0 / (1.0 + np.exp(-(x - 60.0) / 1.5))
    rolling = 2.0 * np.sin(x / 9.0) * np.cos(z / 11.0)
    return HEIGHT + bench + rolling + 0.15 * np.sin(x * 1.3) * np.sin(z * 1.1)


def export(scene, output, **options):
    return export_scene(scene, ExportRequest(output, **options))


def lines_of(path) -> tuple[dict, list[np.ndarray], np.ndarray]:
    """Meta data, lines and heights of a file of contours, as GDAL reads them."""
    meta, _, geometry, (heights, _) = pyogrio.raw.read(path)
    return meta, [np.frombuffer(wkb[9:], "<f8").reshape(-1, 2) for wkb in geometry], heights


@pytest.mark.parametrize("ending", ["gpkg", "geojson"])
def test_contours_lie_at_their_height(scene_path, tmp_path, ending) -> None:
    path = tmp_path / f"c.{ending}"
    export(scene_path, path, step_m=0.5, interval=0.5, extent=BOX)
    meta, lines, heights = lines_of(path)
    assert CRS.from_user_input(meta["crs"]).to_epsg() == 32633
    assert meta["geometry_type"] == "LineString"
    levels = sorted(set(heights))
    assert np.diff(levels).tolist() == [0.5] * (len(levels) - 1)
    assert len(levels) > 8
    for line, height in zip(lines, heights, strict=True):
        # Between two pixels a line is straight, the ground is not.
        assert np.abs(truth(*line.T) - height).max() < 2 * CHORD_M
        assert (line.min(axis=0) >= (BOX.xmin, BOX.ymin)).all()
        assert (line.max(axis=0) <= (BOX.xmax, BOX.ymax)).all()


def test_contours_of_a_drawing_have_elevation_and_layers(scene_path, tmp_path) -> None:
    export(scene_path, tmp_path / "c.dxf", product="contours", step_m=0.5, interval=1.0)
    drawing = ezdxf.readfile(tmp_path / "c.dxf")
    assert drawing.header["$INSUNITS"] == 6  # metres
    assert not drawing.audit().has_errors
    polylines = list(drawing.modelspace().query("LWPOLYLINE"))
    assert {line.dxf.layer for line in polylines} == {"CONTOURS", "CONTOURS_INDEX"}
    for line in polylines:
        assert (line.dxf.layer == "CONTOURS_INDEX") == (line.dxf.elevation % 5 == 0)
        east, north = np.array(line.get_points("xy")).T
        assert np.abs(truth(east, north) - line.dxf.elevation).max() < 2 * CHORD_M
    assert any(line.closed for line in polylines)


def test_a_section_follows_the_ground_along_every_leg(scene_path, tmp_path) -> None:
    export(scene_path, tmp_path / "cut.csv", line=LINE)
    with (tmp_path / "cut.csv").open() as file:
        rows = list(csv.DictReader(file))
    east, north, height, distance = (
        np.array([float(row[name]) for row in rows])
        for name in ("easting", "northing", "height", "distance")
    )
    assert np.abs(height - truth(east, north)).max() < CHORD_M
    first = math.dist((500010, 5999990), (500070.5, 5999950))
    assert (distance[0], distance[-1]) == pytest.approx((0.0, first + 45.0), abs=1e-3)
    # One line per leg: the pieces of all segments are joined, and no point is far from the next.
    assert {row["line"] for row in rows} == {"1", "2"}
    assert np.diff(distance).min() >= -1e-4
    assert np.diff(distance).max() < 0.8
    on_first = distance < first
    expected = 500010 + distance[on_first] * 60.5 / first
    assert np.abs(east[on_first] - expected).max() < 1e-3


def test_a_section_as_a_drawing_is_in_place_and_beside_it_a_profile(scene_path, tmp_path) -> None:
    export(scene_path, tmp_path / "cut.dxf", product="section", line=LINE)
    drawing = ezdxf.readfile(tmp_path / "cut.dxf")
    assert not drawing.audit().has_errors
    space = drawing.modelspace()
    in_place = np.concatenate(
        [[vertex.dxf.location.xyz for vertex in line.vertices] for line in space.query("POLYLINE")]
    )
    assert np.abs(in_place[:, 2] - truth(in_place[:, 0], in_place[:, 1])).max() < CHORD_M
    profile = [line for line in space.query("LWPOLYLINE") if line.dxf.layer == "PROFILE"]
    assert len(profile) == 2
    assert sum(len(line) for line in profile) == len(in_place)
    assert drawing.layers.get("PROFILE").is_off()


def test_a_section_of_a_box_ends_at_its_edges(scene_path, tmp_path) -> None:
    export(scene_path, tmp_path / "cut.csv", line="499990,5999955 500110,5999955", extent=BOX)
    with (tmp_path / "cut.csv").open() as file:
        east = [float(row["easting"]) for row in csv.DictReader(file)]
    assert (min(east), max(east)) == pytest.approx((BOX.xmin, BOX.xmax), abs=1e-3)


def test_what_cannot_be_drawn_is_said(scene_path, tmp_path) -> None:
    wrong = [
        ("a.csv", {}, "--line is what a section is cut along, received none"),
        ("a.gpkg", {"line": LINE}, "received it for contours"),
        ("a.csv", {"line": "1,2"}, "expected two points or more"),
        ("a.csv", {"line": "0,0 1,1"}, "the line meets no surface"),
        ("a.gpkg", {"interval": 0.0}, "interval 0.0; expected a number above 0"),
        ("a.gpkg", {"interval": 1000.0}, "no contour at a multiple of 1000 m"),
        ("a.gpkg", {"interval": 1e-5}, "contour levels, expected at most"),
        ("a.gpkg", {"step_m": 0.001}, "heights, expected at most 100,000,000"),
    ]
    for name, options, said in wrong:
        with pytest.raises(OptionError, match=said):
            export(scene_path, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []
    for text in ("", "1,2 1,2", "1;2 3;4", "1,2,3 4,5,6", "nan,0 1,1"):
        with pytest.raises(OptionError, match="line"):
            parse_line(text)


@pytest.mark.parametrize("crs", [None, "NAD83 / Texas South Central (ftUS)", "mine grid"])
def test_a_geopackage_says_its_crs_whatever_it_is(tmp_path, crs) -> None:
    path = tmp_path / "c.gpkg"
    stated = None if crs is None else CRS.from_epsg(32633)
    if crs == "mine grid":
        stated = CRS.from_proj4("+proj=tmerc +lon_0=13.37 +k=1 +x_0=1000 +y_0=2000 +ellps=WGS84")
    elif crs is not None:
        stated = CRS.from_user_input(crs)
    line = np.array([[0.0, 1.0], [2.0, 3.0], [5.0, -1.0]])
    write_shapes(
        path,
        "contours",
        "LineString",
        [shapely.LineString(line), shapely.LineString(line + 7)],
        {"height": [10.5, 15.0], "is_index": [False, True]},
        SurveyFrame((0.0, 0.0, 0.0), stated),
    )
    meta, _, geometry, (heights, is_index) = pyogrio.raw.read(path, layer="contours")
    assert heights.tolist() == [10.5, 15.0]
    assert is_index.astype(bool).tolist() == [False, True]
    assert np.frombuffer(geometry[0][9:], "<f8").reshape(-1, 2).tolist() == line.tolist()
    info = pyogrio.read_info(path)
    assert info["total_bounds"] == (0.0, -1.0, 12.0, 10.0)
    if stated is None:
        assert meta["crs"] is None or "ndefined" in meta["crs"]
    else:
        assert CRS.from_user_input(meta["crs"]).is_exact_same(stated) or CRS.from_user_input(
            meta["crs"]
        ).equals(stated, ignore_axis_order=True)
