"""Exports of surveys along axes of their own, opened by the programs' libraries.

The fixture's ground is exported as if its survey had counted to the south and west, in depths or
in feet; what is read back must be that ground at the same places.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import laspy
import numpy as np
import pyogrio.raw
import pytest
import rasterio
import shapely
import trimesh
from pyproj import CRS
from tests.pipeline.look.test_export_geotiff import (
    CHORD_M,
    EAST,
    HEIGHT,
    NORTH,
    export,
    restated,
    truth,
)

from terraport.frames import to_crs, to_scene
from terraport_payload.types import Float64
from terraport_pipeline.engines.readers.survey_crs import interpret_coordinates
from terraport_pipeline.export.frame import survey_frame
from terraport_pipeline.extent import Extent
from terraport_pipeline.naming.drawings import read_drawings
from terraport_pipeline.report.survey_crs import crs_line
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_pipeline.upkeep.listing import SceneExtent
from terraport_store import read_manifest

US_FOOT = 1200 / 3937


@dataclass(frozen=True)
class Stated:
    """A CRS, and how its coordinates follow from easting, northing, height in metres."""

    crs: str
    own: Callable[[Float64, Float64, Float64], tuple[Float64, Float64, Float64]]
    metres: Callable[[Float64, Float64, Float64], tuple[Float64, Float64, Float64]]

    def places(self, own: Float64) -> Float64:
        """Easting, northing and height in metres of coordinates (N, 3)."""
        return np.stack(self.metres(*np.asarray(own, np.float64).T), axis=1)


SYSTEMS = {
    "krovak": Stated("EPSG:5513+8357", lambda e, n, h: (-n, -e, h), lambda x, y, z: (-y, -x, z)),
    "lo": Stated("EPSG:2053", lambda e, n, h: (-e, -n, h), lambda x, y, z: (-x, -y, z)),
    "depth": Stated("EPSG:32633+5715", lambda e, n, h: (e, n, -h), lambda x, y, z: (x, y, -z)),
    "mixed": Stated(
        "EPSG:32140+6360",
        lambda e, n, h: (e, n, h / US_FOOT),
        lambda x, y, z: (x, y, z * US_FOOT),
    ),
    "deep-feet": Stated(
        "EPSG:2278+6358",
        lambda e, n, h: (e / US_FOOT, n / US_FOOT, -h / US_FOOT),
        lambda x, y, z: (x * US_FOOT, y * US_FOOT, -z * US_FOOT),
    ),
}


@pytest.fixture(scope="module", params=list(SYSTEMS))
def case(request, scene_path, tmp_path_factory) -> tuple[Path, Stated]:
    """The scene as the build makes it of a survey in that CRS."""
    stated = SYSTEMS[request.param]
    corners = np.array([(EAST, NORTH - 100, HEIGHT - 3), (EAST + 100, NORTH, HEIGHT + 9)])
    own = np.stack(stated.own(*corners.T), axis=1)
    # Stated in metres too, so that it does not matter that this ground is elsewhere on Earth.
    units, crs, _ = interpret_coordinates(
        Path("x.las"), own.min(axis=0), own.max(axis=0), CRS(stated.crs), SurveyStatement()
    )
    assert crs is not None
    assert units is not None
    assert units.crs_wkt
    path = tmp_path_factory.mktemp("axes") / "ground"
    document = {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg}
    return restated(scene_path, path, document, units.document()), stated


def is_on_the_ground(places: Float64) -> bool:
    """Whether places are on the fixture's ground and within it."""
    east, north, height = places.T
    inside = (east >= EAST - 0.01) & (east <= EAST + 100.01)
    inside &= (north >= NORTH - 100.01) & (north <= NORTH + 0.01)
    return bool(inside.all() and np.abs(height - truth(east, north)).max() < CHORD_M + 0.005)


def named(crs: object, stated: Stated) -> bool:
    """Whether what a file states is the survey's CRS."""
    found = CRS.from_user_input(crs)
    return found == CRS(stated.crs) or found.sub_crs_list == CRS(stated.crs).sub_crs_list != []


def test_points_are_back_in_the_surveys_crs(case, tmp_path) -> None:
    scene, stated = case
    export(scene, tmp_path / "p.laz")
    points = laspy.read(tmp_path / "p.laz")
    assert named(points.header.parse_crs(), stated)
    assert is_on_the_ground(stated.places(np.stack([points.x, points.y, points.z], axis=1)))


def test_rasters_are_back_in_the_surveys_crs(case, tmp_path) -> None:
    scene, stated = case
    own = stated.own(
        np.array([EAST + 20, EAST + 40]), np.array([NORTH - 50, NORTH - 20]), np.zeros(2)
    )
    box = Extent(own[0].min(), own[1].min(), own[0].max(), own[1].max())
    export(scene, tmp_path / "h.tif", product="heights", step_m=0.5, extent=box)
    export(scene, tmp_path / "o.tif", product="orthophoto", step_m=0.5, extent=box)
    with rasterio.open(tmp_path / "h.tif") as picture:
        columns, rows = np.meshgrid(np.arange(picture.width), np.arange(picture.height))
        x, y = picture.transform @ (columns.ravel() + 0.5, rows.ravel() + 0.5)
        found = picture.read(1).ravel().astype(float)
        assert (found != picture.nodata).all()
        is_deep = CRS(stated.crs).axis_info[-1].direction == "down"
        assert picture.descriptions == ("depth" if is_deep else "height",)
        plan = CRS.from_user_input(picture.crs.to_wkt())
        assert (plan.sub_crs_list or [plan])[0] == (
            CRS(stated.crs).sub_crs_list or [CRS(stated.crs)]
        )[0]
        # By the place of a pixel and by the pixel of a place.
        sampled = [value[0] for value in picture.sample(list(zip(x, y, strict=True)))]
        transform = picture.transform
    np.testing.assert_allclose(sampled, found)
    assert is_on_the_ground(stated.places(np.stack([x, y, found], axis=1)))
    assert box.xmin <= x.min() <= x.max() <= box.xmax
    assert len(x) == 40 * 60
    with rasterio.open(tmp_path / "o.tif") as picture:
        assert picture.transform == transform
        red = picture.read(1).ravel().astype(float)
    east, north, _ = stated.metres(x, y, found)
    shade = np.clip((truth(east, north) - HEIGHT + 2) / 10, 0, 1)
    assert np.abs(red - 150 * (0.5 + 0.5 * shade)).max() < 4


def test_lines_are_back_in_the_surveys_crs(case, tmp_path) -> None:
    scene, stated = case
    unit = US_FOOT if "2278" in stated.crs else 1.0
    interval = 1.0
    for name in ("c.gpkg", "c.dxf"):
        export(scene, tmp_path / name, product="contours", step_m=0.5, interval=interval)
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / "c.gpkg", layer="contours")
    assert named(meta["crs"], stated)
    heights = columns[list(meta["fields"]).index("height")]
    lines = shapely.from_wkb(geometry)
    own = np.concatenate(
        [
            np.insert(shapely.get_coordinates(line), 2, height, axis=1)
            for line, height in zip(lines, heights, strict=True)
        ]
    )
    places = stated.places(own)
    slack = np.abs(places[:, 2] - truth(places[:, 0], places[:, 1]))
    assert np.percentile(slack, 95) < 0.05
    drawn = ezdxf.readfile(tmp_path / "c.dxf").modelspace().query("LWPOLYLINE")
    corners = np.concatenate(
        [np.insert(np.array(one.get_points("xy")), 2, one.dxf.elevation, axis=1) for one in drawn]
    )
    assert np.abs(np.sort(corners[:, 2]) - np.sort(own[:, 2])[: len(corners)]).max() < 99
    assert set(np.round(corners[:, 2], 6)) == set(np.round(own[:, 2], 6))
    assert np.abs(corners.min(axis=0) - own.min(axis=0)).max() < 1e-6
    # A section along a line of the survey's coordinates.
    ends = stated.own(
        np.array([EAST + 10, EAST + 80]), np.array([NORTH - 30, NORTH - 60]), np.zeros(2)
    )
    text = " ".join(f"{x:.6f},{y:.6f}" for x, y in zip(ends[0], ends[1], strict=True))
    export(scene, tmp_path / "s.csv", product="section", line=text)
    rows = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1)
    cut = stated.places(rows[:, 2:5])
    assert is_on_the_ground(cut)
    assert cut[:, 0].min() == pytest.approx(EAST + 10, abs=0.01)
    assert rows[:, 1].max() * unit == pytest.approx(np.hypot(70, 30), abs=0.01)
    header = (tmp_path / "s.csv").read_text().splitlines()[0]
    assert ("depth" in header) == ("down" in {a.direction for a in CRS(stated.crs).axis_info})


@pytest.mark.parametrize("name", ["m.ply", "m.obj"])
def test_meshes_are_back_in_the_surveys_crs(case, tmp_path, name) -> None:
    scene, stated = case
    export(scene, tmp_path / name)
    mesh = trimesh.load(tmp_path / name, process=False)
    shift = np.loadtxt(tmp_path / f"{name}.offset.xyz")
    assert is_on_the_ground(stated.places(np.asarray(mesh.vertices) + shift))
    # Faces look to where the ground's upper side is, for programs that take z for up.
    normals = np.asarray(mesh.face_normals)
    is_deep = "down" in {axis.direction for axis in CRS(stated.crs).axis_info}
    assert np.median(normals[:, 2]) < -0.5 if is_deep else np.median(normals[:, 2]) > 0.5


def test_everything_names_one_crs_and_one_place(case, tmp_path) -> None:
    scene, stated = case
    manifest = read_manifest(scene)
    frame = survey_frame(manifest)
    assert frame.crs == CRS(stated.crs)
    assert crs_line(manifest)[0].startswith(CRS(stated.crs).name)
    # The clients' conversion is the exports'.
    units = manifest.survey_units
    assert units is not None
    positions = np.float32([[12.5, 3.25, 40.125], [99.0, -2.0, 0.0]])
    own = to_crs(positions, manifest.origin, units.document())
    np.testing.assert_allclose(own, frame.to_survey(positions), rtol=0, atol=1e-9)
    metres = np.array([EAST, NORTH, HEIGHT]) + positions[:, [0, 2, 1]] * [1, -1, 1]
    np.testing.assert_allclose(stated.places(own), metres, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        to_scene(own, manifest.origin, units.document()), positions, rtol=0, atol=1e-8
    )
    # A drawing in the survey's coordinates lies where it was drawn, and a list says its extent.
    x, y, _ = stated.own(
        np.array([EAST + 10, EAST + 30]), np.array([NORTH - 40, NORTH - 20]), np.zeros(2)
    )
    box = shapely.box(x.min(), y.min(), x.max(), y.max())
    pyogrio.raw.write(
        tmp_path / "plan.gpkg",
        geometry=shapely.to_wkb(np.array([box])),
        field_data=[np.array(["ramp"], object)],
        fields=["name"],
        geometry_type="Polygon",
        crs=CRS(stated.crs).to_wkt(),
        driver="GPKG",
        layer="plan",
    )
    drawings = read_drawings(tmp_path / "plan.gpkg", frame)
    bounds = shapely.total_bounds([drawing.shape for drawing in drawings.drawings])
    np.testing.assert_allclose(bounds, (10, 20, 30, 40), atol=1e-6)
    extent = SceneExtent.of(manifest)
    assert extent.east[0] < extent.east[1]
    assert extent.north[0] < extent.north[1]
    ends = stated.own(np.array([EAST, EAST + 100]), np.array([NORTH - 100, NORTH]), np.zeros(2))
    assert extent.east == pytest.approx((min(ends[0]), max(ends[0])), abs=20)
    assert extent.north == pytest.approx((min(ends[1]), max(ends[1])), abs=20)
