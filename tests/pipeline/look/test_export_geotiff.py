"""Orthophotos and height models, opened by rasterio: where they are, and how high the ground is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import ezdxf
import laspy
import numpy as np
import pyogrio.raw
import pytest
import rasterio
import trimesh
from numpy.testing import assert_array_equal
from pyproj import CRS

from terraport_pipeline.engines.readers.survey_crs import interpret_coordinates
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export import sampling
from terraport_pipeline.export.frame import survey_frame
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.extent import Extent
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import change_labels, read_manifest

EAST, NORTH, HEIGHT = 500_000.0, 6_000_000.0, 120.0
"""Origin of the fixture's scene: its ground spans 100 m east and south of it."""

CHORD_M = 0.03
"""Farthest that the fixture's mesh (cells of 0.5 m) is from the ground that it was made of."""

FEET = "NAD83 / Texas South Central (ftUS)"


def truth(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Height of the fixture's ground, metres."""
    x, z = east - EAST, NORTH - north
    bench = 6.0 / (1.0 + np.exp(-(x - 60.0) / 1.5))
    return (
        HEIGHT
        + bench
        + 2.0 * np.sin(x / 9.0) * np.cos(z / 11.0)
        + 0.15 * np.sin(x * 1.3) * np.sin(z * 1.1)
    )


def centres(picture: rasterio.DatasetReader) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing of every pixel's centre."""
    columns, rows = np.meshgrid(np.arange(picture.width), np.arange(picture.height))
    east, north = picture.transform @ (columns + 0.5, rows + 0.5)
    return east, north


def restated(
    scene_path: Path,
    path: Path,
    crs: dict[str, object] | None,
    units: dict[str, object] | None = None,
) -> Path:
    """Copy a scene as if its survey had stated another CRS, or been in other units."""
    shutil.copytree(scene_path, path)
    document = json.loads((path / "scene.json").read_text())
    document["crs"] = crs
    document["survey_units"] = units
    (path / "scene.json").write_text(json.dumps(document))
    return path


@pytest.fixture(scope="module")
def in_feet(scene_path, tmp_path_factory) -> Path:
    """The scene as the build makes it of a survey in US survey feet."""
    low, high = np.array([2e6, 1.37e7, 100.0]), np.array([2.001e6, 1.3701e7, 150.0])
    feet, metric, _ = interpret_coordinates(Path("x.laz"), low, high, CRS.from_user_input(FEET))
    assert metric is not None
    assert feet is not None
    units = feet.document()
    path = tmp_path_factory.mktemp("feet") / "ground"
    crs = {"name": metric.name, "wkt": metric.wkt, "epsg": None}
    return restated(scene_path, path, crs, units)


def export(scene: Path, output: Path, **options: object):
    return export_scene(scene, ExportRequest(output, **options))


@pytest.fixture(scope="module")
def heights(scene_path, tmp_path_factory) -> Path:
    """The height model at 0.4 m."""
    path = tmp_path_factory.mktemp("export") / "heights.tif"
    export(scene_path, path, product="heights", step_m=0.4)
    return path


def test_a_height_model_is_the_ground_in_the_surveys_crs(heights) -> None:
    with rasterio.open(heights) as picture:
        assert picture.crs.to_epsg() == 32633
        assert picture.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert (picture.nodata, picture.units, picture.descriptions) == (
            -9999,
            ("metre",),
            ("height",),
        )
        assert picture.bounds == (EAST, NORTH - 100, EAST + 100, NORTH)
        assert picture.overviews(1) == []  # smaller than a tile
        found = picture.read(1, masked=True)
        assert not found.mask.any()
        assert np.abs(found - truth(*centres(picture))).max() < CHORD_M


def test_a_window_at_a_time_gives_the_same_heights(
    scene_path, heights, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(sampling, "_MAX_WINDOW", 9_000)
    monkeypatch.setattr(sampling, "_BAND_RAYS", 1_000)
    export(scene_path, tmp_path / "small.tif", product="heights", step_m=0.4)
    with rasterio.open(heights) as whole, rasterio.open(tmp_path / "small.tif") as cut:
        assert np.abs(whole.read(1) - cut.read(1)).max() < 1e-4


def test_an_orthophoto_has_the_colours_of_the_ground(scene_path, tmp_path) -> None:
    done = export(scene_path, tmp_path / "o.tif", product="orthophoto", step_m=0.1)
    assert done.companions == ()
    with rasterio.open(tmp_path / "o.tif") as picture:
        assert picture.crs.to_epsg() == 32633
        assert picture.shape == (1000, 1000)
        assert picture.overviews(1) == [2]
        red, green, blue, alpha = picture.read().astype(float)
        shade = np.clip((truth(*centres(picture)) - HEIGHT + 2) / 10, 0, 1)
    assert (alpha == 255).all()
    for levels, full in ((red, 150), (green, 120), (blue, 90)):
        assert np.abs(levels - full * (0.5 + 0.5 * shade)).max() < 4


def test_a_box_has_the_pixels_whose_centres_are_in_it(scene_path, heights, tmp_path) -> None:
    box = Extent(EAST + 10.1, NORTH - 60.3, EAST + 30.9, NORTH - 40.0)
    export(scene_path, tmp_path / "box.tif", product="heights", step_m=0.4, extent=box)
    with rasterio.open(tmp_path / "box.tif") as cut, rasterio.open(heights) as whole:
        east, north = centres(cut)
        assert box.xmin <= east.min() < box.xmin + 0.4
        assert box.xmax - 0.4 < east.max() <= box.xmax
        assert box.ymin <= north.min() < box.ymin + 0.4
        assert box.ymax - 0.4 < north.max() <= box.ymax
        window = whole.window(*cut.bounds)
        # Pixels of all exports at one step are the same places.
        assert np.abs(whole.read(1, window=window) - cut.read(1)).max() < 1e-4


def test_a_region_by_its_label_or_number_and_nothing_else(
    write_scene, model, detail, base, tmp_path
) -> None:
    rows = [{"id": 0, "stable_id": 4}, {"id": 1, "stable_id": 9}]
    scene = write_scene(
        tmp_path / "pit", model, detail, base, regions={"regions": rows, "next_stable_id": 10}
    )
    change_labels(scene, {9: "Upper bench"})
    for number, wanted in enumerate(("upper BENCH", "9")):
        path = tmp_path / f"{number}.tif"
        export(scene, path, product="heights", step_m=0.5, regions=(wanted,))
        with rasterio.open(path) as picture:
            # Region 1 are the tiles east of 60 m, the fifth begins at 62.5.
            assert picture.bounds.left == pytest.approx(EAST + 62.5)
            assert picture.bounds.right == pytest.approx(EAST + 100)
    with pytest.raises(
        OptionError, match="region 'floor'; expected one of 'Upper bench', or a stable id, 4 to 9"
    ):
        export(scene, tmp_path / "n.tif", product="heights", regions=("floor",))


def test_a_survey_in_feet_is_handed_on_in_feet(in_feet, tmp_path) -> None:
    foot = 1200 / 3937
    frame = survey_frame(read_manifest(in_feet))
    assert frame.crs is not None
    assert (frame.crs.name, frame.unit_name, frame.height_unit_name) == (FEET, "us-ft", "us-ft")
    box = Extent(*(value / foot for value in (EAST + 20, NORTH - 50, EAST + 40, NORTH - 30)))
    done = export(in_feet, tmp_path / "h.tif", product="heights", step_m=foot, extent=box)
    assert (done.crs, done.unit) == (FEET, "us-ft")
    with rasterio.open(tmp_path / "h.tif") as picture:
        assert CRS.from_wkt(picture.crs.to_wkt()).equals(
            CRS.from_user_input(FEET), ignore_axis_order=True
        )
        assert picture.res == pytest.approx((1.0, 1.0))
        assert picture.units == ("US survey foot",)
        east, north = centres(picture)
        expected = truth(east * foot, north * foot) / foot
        assert np.abs(picture.read(1) - expected).max() < CHORD_M / foot


def test_a_scene_without_a_crs_keeps_its_coordinates(scene_path, heights, tmp_path) -> None:
    scene = restated(scene_path, tmp_path / "nowhere", None)
    done = export(scene, tmp_path / "h.tif", product="heights", step_m=0.4)
    assert done.crs == "no coordinate reference system stated"
    with rasterio.open(tmp_path / "h.tif") as bare, rasterio.open(heights) as stated:
        assert bare.crs is None
        assert bare.bounds == stated.bounds
        assert_array_equal(bare.read(1), stated.read(1))


def test_an_unknown_name_in_feet_stays_in_metres(scene_path, tmp_path) -> None:
    crs = {"name": "Mine grid (in metres)", "wkt": CRS.from_epsg(32633).to_wkt(), "epsg": None}
    units = {"horizontal_m": 0.3048, "height_m": 0.3048}
    frame = survey_frame(read_manifest(restated(scene_path, tmp_path / "mine", crs, units)))
    assert (frame.unit_m, frame.crs) == (1.0, CRS.from_epsg(32633))


def test_feet_without_a_crs_are_feet_and_heights_have_their_own(scene_path, tmp_path) -> None:
    feet = {"horizontal_m": 0.3048, "height_m": 0.3048}
    bare = survey_frame(read_manifest(restated(scene_path, tmp_path / "bare", None, feet)))
    assert (bare.crs, bare.unit_name, bare.height_unit_name) == (None, "ft", "ft")
    low, high = np.array([5e5, 6e6, 300.0]), np.array([5.001e5, 6.0001e6, 350.0])
    own, metric, _ = interpret_coordinates(
        Path("x.laz"), low, high, CRS(32633), SurveyStatement(height_units="us-ft")
    )
    assert own is not None
    assert metric is not None
    assert metric.epsg == 32633
    crs, units = {"name": metric.name, "wkt": metric.wkt, "epsg": 32633}, own.document()
    tall = survey_frame(read_manifest(restated(scene_path, tmp_path / "tall", crs, units)))
    assert tall.crs == CRS.from_epsg(32633)
    assert (tall.unit_m, tall.height_unit_name) == (1.0, "us-ft")


def test_everything_else_in_feet_is_in_feet_but_glb(in_feet, tmp_path) -> None:
    foot = 1200 / 3937
    box = Extent(*(value / foot for value in (EAST + 20, NORTH - 50, EAST + 40, NORTH - 30)))
    export(in_feet, tmp_path / "p.laz", extent=box)
    points = laspy.read(tmp_path / "p.laz")
    assert points.header.parse_crs().name == FEET
    east, north, height = (np.asarray(axis) * foot for axis in (points.x, points.y, points.z))
    assert np.abs(height - truth(east, north)).max() < 0.05
    assert box.xmin <= points.x.min() < points.x.max() <= box.xmax

    for name in ("m.ply", "m.glb"):
        done = export(in_feet, tmp_path / name, extent=box)
        mesh = trimesh.load(tmp_path / name, process=False, force="mesh")
        vertices = mesh.vertices
        unit = foot
        if name == "m.glb":
            # glTF is in metres: so is its shift, and the CRS that it states.
            vertices, unit = vertices[:, [0, 2, 1]] * (1, -1, 1), 1.0
        shift = np.loadtxt(tmp_path / f"{name}.offset.xyz")
        assert (shift == np.round(shift)).all()
        east, north, height = (vertices + shift).T * unit
        assert np.abs(height - truth(east, north)).max() < 0.05
        assert (east.min(), east.max()) == pytest.approx((EAST + 20, EAST + 40), abs=1e-4)
        assert done.unit == ("m" if name == "m.glb" else "us-ft")

    line = " ".join(
        f"{e / foot},{n / foot}" for e, n in ((500_010, 5_999_950), (500_090, 5_999_940))
    )
    export(in_feet, tmp_path / "s.dxf", product="section", line=line)
    drawing = ezdxf.readfile(tmp_path / "s.dxf")
    assert drawing.header["$INSUNITS"] == 21  # US survey feet
    (cut,) = drawing.modelspace().query("POLYLINE")
    east, north, height = np.array([v.dxf.location.xyz for v in cut.vertices]).T * foot
    assert np.abs(height - truth(east, north)).max() < CHORD_M

    export(in_feet, tmp_path / "c.gpkg", interval=2.0, step_m=0.5, extent=box)
    meta, _, geometry, (heights, _) = pyogrio.raw.read(tmp_path / "c.gpkg")
    assert CRS.from_user_input(meta["crs"]).axis_info[0].unit_name == "US survey foot"
    assert (heights % 2 == 0).all()
    east, north = np.frombuffer(geometry[0][9:], "<f8").reshape(-1, 2).T * foot
    assert np.abs(truth(east, north) - heights[0] * foot).max() < 2 * CHORD_M


def test_without_a_crs_every_file_is_written_and_states_none(scene_path, tmp_path) -> None:
    scene = restated(scene_path, tmp_path / "nowhere", None)
    for name in ("p.laz", "m.ply", "m.glb", "c.gpkg", "c.geojson"):
        export(scene, tmp_path / name)
    assert laspy.read(tmp_path / "p.laz").header.parse_crs() is None
    assert b"none stated" in (tmp_path / "m.ply").read_bytes()[:400]
    assert b'"crs":null' in (tmp_path / "m.glb").read_bytes()[:400]
    assert "crs" not in json.loads((tmp_path / "c.geojson").read_text())
