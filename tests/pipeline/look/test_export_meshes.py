"""Meshes and points for other programs, opened by trimesh and laspy: where they are."""

from __future__ import annotations

import io
import json

import laspy
import numpy as np
import pytest
import rasterio
import trimesh
from glb_file import split_glb
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from pyproj import CRS
from textured_square import SIDE_M, quadrants, write_square

from terraport_pipeline.engines.gltf_validator import check_gltf
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.export import gathered
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.extent import Extent
from terraport_store import Scene

EAST, NORTH, HEIGHT = 500_000.0, 6_000_000.0, 120.0
STEP_M = 2.0**-10
BOX = Extent(EAST + 20.2, NORTH - 70.7, EAST + 41.3, NORTH - 30.1)


def truth(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    x, z = east - EAST, NORTH - north
    bench = 6.0 / (1.0 + np.exp(-(x - 60.0) / 1.5))
    rolling = 2.0 * np.sin(x / 9.0) * np.cos(z / 11.0)
    return HEIGHT + bench + rolling + 0.15 * np.sin(x * 1.3) * np.sin(z * 1.1)


def export(scene, output, **options):
    return export_scene(scene, ExportRequest(output, **options))


def loaded(path) -> trimesh.Trimesh:
    """A mesh with the coordinates of the survey: what it holds, plus the shift beside it."""
    mesh = trimesh.load(path, process=False)
    mesh = mesh.to_geometry() if isinstance(mesh, trimesh.Scene) else mesh
    if path.suffix == ".glb":
        mesh.vertices = mesh.vertices[:, [0, 2, 1]] * (1, -1, 1)
        return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return mesh


def shift_beside(path) -> np.ndarray:
    return np.loadtxt(path.with_name(f"{path.name}.offset.xyz"))


@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_a_mesh_plus_its_shift_is_the_ground(scene_path, detail, tmp_path, ending) -> None:
    path = tmp_path / f"pit.{ending}"
    export(scene_path, path)
    shift = shift_beside(path)
    assert_array_equal(shift, [EAST, NORTH, HEIGHT])
    mesh = loaded(path)
    east, north, height = (mesh.vertices + shift).T
    # Vertices of the fixture lie on the ground; they moved by half a grid step at most.
    assert np.abs(height - truth(east, north)).max() < 2 * STEP_M
    # One vertex where segments meet: as many as the ground was made of, and one open rim.
    assert (len(mesh.vertices), len(mesh.faces)) == (len(detail.vertices), len(detail.faces))
    assert mesh.area == pytest.approx(
        trimesh.Trimesh(detail.vertices, detail.faces, process=False).area, rel=1e-4
    )
    assert mesh.face_normals[:, 2].mean() > 0.8  # outside is up


def test_the_shift_stands_in_every_file_too(scene_path, tmp_path) -> None:
    for ending in ("ply", "obj", "glb"):
        export(scene_path, tmp_path / f"pit.{ending}", extent=BOX)
    line = b"global shift (add to x y z): 500000.000 6000000.000 120.000"
    assert line in (tmp_path / "pit.ply").read_bytes()[:600]
    assert line in (tmp_path / "pit.obj").read_bytes()[:600]
    document, _ = split_glb((tmp_path / "pit.glb").read_bytes())
    extras = document["asset"]["extras"]
    assert extras["global_shift"] == [EAST, NORTH, HEIGHT]
    assert CRS.from_wkt(extras["crs"]).to_epsg() == 32633
    # CloudCompare's list: name ; what it adds to whole coordinates ; scale
    line = (tmp_path / "pit.glb.global_shift.txt").read_text()
    assert line == "rolling _ground_ ; -500000.000 ; -6000000.000 ; -120.000 ; 1.0\n"


@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_whole_coordinates_have_64_bits_and_no_shift(scene_path, tmp_path, ending) -> None:
    path = tmp_path / f"pit.{ending}"
    done = export(scene_path, path, full_coordinates=True)
    assert done.companions == ()
    mesh = loaded(path)
    assert_allclose(mesh.bounds[:, :2], [[EAST, NORTH - 100], [EAST + 100, NORTH]], atol=STEP_M)
    assert np.abs(mesh.vertices[:, 2] - truth(*mesh.vertices[:, :2].T)).max() < 2 * STEP_M


def test_colours_come_along(scene_path, detail, tmp_path) -> None:
    for ending in ("ply", "obj"):
        export(scene_path, tmp_path / f"pit.{ending}")
        mesh = loaded(tmp_path / f"pit.{ending}")
        order = np.lexsort(np.round(mesh.vertices[:, [1, 0]], 1).T)
        before = np.lexsort(np.round(detail.vertices[:, [2, 0]] * (-1, 1), 1).T)
        colours = np.asarray(mesh.visual.vertex_colors)[order, :3].astype(int)
        assert np.abs(colours - detail.colours[before]).max() <= 1
    export(scene_path, tmp_path / "pit.glb")
    document, binary = split_glb((tmp_path / "pit.glb").read_bytes())
    primitive = document["meshes"][0]["primitives"][0]
    accessor = document["accessors"][primitive["attributes"]["COLOR_0"]]
    view = document["bufferViews"][accessor["bufferView"]]
    start = view["byteOffset"]
    linear = np.frombuffer(binary[start : start + view["byteLength"]], "<u2") / 65535
    # glTF's colours are linear: sRGB 75 to 150 are 0.07 to 0.31.
    assert 0.06 < linear.reshape(-1, 4)[:, 0].min() < linear.reshape(-1, 4)[:, 0].max() < 0.32


@pytest.mark.parametrize("ending", ["ply", "glb"])
def test_a_box_is_cut_exactly(scene_path, tmp_path, ending) -> None:
    path = tmp_path / f"pit.{ending}"
    export(scene_path, path, extent=BOX)
    mesh = loaded(path)
    low, high = mesh.bounds + shift_beside(path)
    assert_allclose([*low[:2], *high[:2]], BOX.values, atol=1e-5)
    # Seen from above the triangles fill the box: nothing is missing, nothing twice.
    flat = mesh.triangles[:, :, :2]
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert area.min() > -1e-6
    assert area.sum() == pytest.approx((BOX.xmax - BOX.xmin) * (BOX.ymax - BOX.ymin), rel=1e-5)
    assert not mesh.is_watertight
    assert mesh.body_count == 1


def test_too_large_a_mesh_is_refused_before_it_is_read(scene_path, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(gathered, "MAX_MESH_FACES", 79_999)
    with pytest.raises(ResourceError, match="80,000 triangles, expected at most 79,999"):
        export(scene_path, tmp_path / "pit.ply")
    assert list(tmp_path.iterdir()) == []


def test_triangles_that_the_grid_made_a_line_are_left_out(tmp_path) -> None:
    scene = tmp_path / "square"
    # A fifth vertex at the place of the first: a triangle without width.
    write_square(scene, sliver=True)
    for ending in ("ply", "obj", "glb"):
        export(scene, tmp_path / f"sq.{ending}")
    for name in ("sq.ply", "sq.obj"):
        mesh = trimesh.load(tmp_path / name, process=False, force="mesh")
        assert len(mesh.faces) == 2
    assert trimesh.load(tmp_path / "sq.glb", force="mesh").area == pytest.approx(SIDE_M**2)


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_points_are_on_the_ground_with_region_and_attribute(scene_path, tmp_path, ending) -> None:
    path = tmp_path / f"pit.{ending}"
    export(scene_path, path)
    points = laspy.read(path)
    assert points.header.parse_crs().to_epsg() == 32633
    assert len(points) == 80_000
    assert np.abs(points.z - truth(np.asarray(points.x), np.asarray(points.y))).max() < 0.05
    assert_array_equal(points.region, (np.asarray(points.x) - EAST > 62.5).astype(int))
    assert_allclose(points.grade, (np.asarray(points.x) - EAST) / 100, atol=2e-3)
    assert (points.red.max(), points.red.min()) > (140 * 257, 60 * 257)
    assert (points.classification == 0).all()


def test_points_of_a_box_are_in_it(scene_path, tmp_path) -> None:
    export(scene_path, tmp_path / "pit.laz", extent=BOX)
    points = laspy.read(tmp_path / "pit.laz")
    assert (points.x >= BOX.xmin).all()
    assert (points.x <= BOX.xmax).all()
    assert (points.y >= BOX.ymin).all()
    assert (points.y <= BOX.ymax).all()
    assert len(points) > 2 * 4 * 21 * 40


def test_stable_ids_stand_in_the_points(write_scene, model, detail, base, tmp_path) -> None:
    rows = [{"id": 0, "stable_id": 4}, {"id": 1, "stable_id": 9}]
    regions = {"regions": rows, "next_stable_id": 10}
    scene = write_scene(tmp_path / "pit", model, detail, base, regions=regions)
    export(scene, tmp_path / "pit.laz")
    assert np.unique(laspy.read(tmp_path / "pit.laz").region).tolist() == [4, 9]


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    """A textured scene, and its image file."""
    path = tmp_path_factory.mktemp("square") / "square"
    return path, write_square(path)


def test_textures_come_along_as_they_are(square, tmp_path) -> None:
    scene, image = square
    done = export(scene, tmp_path / "sq.obj")
    assert set(done.companions) == {
        "sq.mtl", "sq_textures", "sq.obj.offset.xyz", "sq.obj.global_shift.txt"
    }  # fmt: skip
    files = list((tmp_path / "sq_textures").iterdir())
    assert [file.read_bytes() for file in files] == [image]
    assert f"map_Kd sq_textures/{files[0].name}" in (tmp_path / "sq.mtl").read_text()
    export(scene, tmp_path / "sq.glb")
    document, binary = split_glb((tmp_path / "sq.glb").read_bytes())
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    assert bytes(binary[view["byteOffset"] :][: view["byteLength"]]) == image
    assert "extensionsUsed" not in document
    for name in ("sq.obj", "sq.glb"):
        mesh = trimesh.load(tmp_path / name, process=False)
        mesh = mesh.to_geometry() if isinstance(mesh, trimesh.Scene) else mesh
        north = -mesh.vertices[:, 2] if name == "sq.glb" else mesh.vertices[:, 1]
        # trimesh turns v: 0 is the image's lower edge, the square's southern one.
        across = np.stack([mesh.vertices[:, 0], north + SIDE_M], axis=1) / SIDE_M
        assert_allclose(mesh.visual.uv, across, atol=1 / 128)
        picture = mesh.visual.material
        picture = getattr(picture, "baseColorTexture", None) or picture.image
        assert_array_equal(np.asarray(picture.convert("RGB")), quadrants())


def test_an_orthophoto_of_a_texture_is_the_texture(square, tmp_path) -> None:
    scene, image = square
    export(scene, tmp_path / "sq.tif", product="orthophoto", step_m=SIDE_M / 64)
    with rasterio.open(tmp_path / "sq.tif") as picture:
        levels = picture.read()
    assert levels.shape == (4, 64, 64)
    truth_image = np.asarray(Image.open(io.BytesIO(image))).transpose(2, 0, 1).astype(int)
    off = np.abs(levels[:3].astype(int) - truth_image).max(axis=0)
    # Each pixel is the mean of its quarters, which reach half a texel into the next.
    assert (off > 1).sum() <= 4 * 64
    assert (levels[3] == 255).all()


def test_points_have_the_colours_of_the_texture(square, tmp_path) -> None:
    scene, _ = square
    export(scene, tmp_path / "sq.las")
    points = laspy.read(tmp_path / "sq.las")
    colours = np.stack([points.red, points.green, points.blue], axis=1) // 257
    # Centres of the two halves: south-west and north-east.
    assert sorted(map(tuple, colours.tolist())) == [(30, 180, 50), (40, 60, 210)]


def test_what_does_not_go_together_is_said(scene_path, tmp_path) -> None:
    wrong = [
        ({"output": tmp_path / "a.stl"}, r"a.stl ends with '.stl', expected one of .tif"),
        ({"output": tmp_path / "a.tif"}, "may be orthophoto or heights; add --as orthophoto"),
        (
            {"output": tmp_path / "a.obj", "product": "heights"},
            "expected a name that ends with .tif",
        ),
        ({"output": tmp_path / "a.obj", "step_m": 1.0}, "--step-m is of pictures"),
        ({"output": tmp_path / "a.las", "full_coordinates": True}, "is of meshes"),
        ({"output": tmp_path / "a.glb", "full_coordinates": True}, "32 bits; expected .ply or"),
        ({"output": tmp_path / "no" / "a.obj"}, "is not there"),
        ({"output": tmp_path / "a.tif", "product": "heights", "step_m": 1e-7}, "pixels, expected"),
        ({"output": tmp_path / "a.obj", "extent": Extent(0, 0, 9, 9)}, "nothing of the scene"),
    ]
    for options, said in wrong:
        with pytest.raises(OptionError, match=said):
            export_scene(scene_path, ExportRequest(**options))
    assert list(tmp_path.iterdir()) == []
    export(scene_path, tmp_path / "a.ply", extent=BOX)
    with pytest.raises(OptionError, match="exists already"):
        export(scene_path, tmp_path / "a.ply", extent=BOX)
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"a.ply", "a.ply.offset.xyz", "a.ply.global_shift.txt"}


def test_a_scene_is_only_read(scene_path, tmp_path) -> None:
    before = {file: file.stat().st_mtime_ns for file in scene_path.rglob("*")}
    export(scene_path, tmp_path / "pit.laz", extent=BOX)
    with Scene.open(scene_path) as scene:
        assert (
            json.loads((scene_path / "scene.json").read_text())["version"] == scene.manifest.version
        )
    assert before == {file: file.stat().st_mtime_ns for file in scene_path.rglob("*")}


def test_khronos_finds_nothing_wrong_in_what_is_written(scene_path, square, tmp_path) -> None:
    """Whole, cut by a box, and textured: no error and no warning."""
    export(scene_path, tmp_path / "whole.glb")
    export(scene_path, tmp_path / "cut.glb", extent=BOX)
    export(square[0], tmp_path / "textured.glb")
    check = check_gltf({path.name: path.read_bytes() for path in sorted(tmp_path.glob("*.glb"))})
    if check.not_run:
        pytest.skip(check.not_run)
    assert (check.checked, check.messages, check.errors, check.warnings) == (3, (), 0, 0)
