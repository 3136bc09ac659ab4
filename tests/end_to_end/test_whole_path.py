"""From a survey's file to arrays in a client: what went in comes out, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
import pytest
from command_line import Built, run_terraport
from end_to_end.conftest import BUILD
from pipeline.one_piece import runner_in, surface_in_tiles
from scipy.spatial import Delaunay, cKDTree

import terraport.sync
from terraport_payload import box_distances_m
from terraport_pipeline.model import Mesh, Survey, to_crs, to_scene
from terraport_pipeline.options import regions as segment
from terraport_pipeline.stages import pack
from terraport_pipeline.workflow.pack_step import publish_tiles
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_server.background_server import BackgroundServer
from terraport_store import Scene
from terraport_store.manifest import BuildInfo, InputInfo


@pytest.fixture(scope="module")
def server(built: Built) -> Iterator[BackgroundServer]:
    with BackgroundServer(built.scenes) as running:
        yield running


@pytest.fixture(scope="module")
def survey(built: Built) -> Survey:
    """The survey read by another reader than terraport's own."""
    las = laspy.read(built.survey)
    return Survey(
        points=np.asarray(las.xyz),
        colours=(np.stack([las.red, las.green, las.blue], axis=1) >> 8).astype(np.uint8),
        attributes={"grade": np.asarray(las["grade"], dtype=np.float32)},
        crs=None,
        format="las",
    )


def places(scene: Scene, count: int) -> list[tuple[float, float, float]]:
    """Positions on segments spread over the scene."""
    bounds = scene.index.bounds[:: max(1, len(scene.index) // count)][:count]
    return [tuple(map(float, (box[:3] + box[3:]) / 2)) for box in bounds]


def test_a_landing_brings_the_bytes_of_the_index_and_no_others(
    built: Built, server: BackgroundServer
) -> None:
    with Scene.open(built.scene) as scene:
        for position in places(scene, 6):
            with terraport.sync.connect(server.scene_url("quarry")) as session:
                landing = session.land(position, radius_m=50.0)
                segments = landing.ready(timeout_s=30)
                distance_m = box_distances_m(scene.index.bounds, position)
                expected = set(np.flatnonzero(distance_m <= 50.0).tolist())
                assert expected
                assert {segment.id for segment in segments} == expected
                assert landing.plan.load_bytes == sum(
                    int(scene.index.length[number]) for number in expected
                )
                for segment in segments:
                    assert segment.payload == bytes(scene.payload(segment.id))


def test_going_back_costs_no_bytes(built: Built, server: BackgroundServer) -> None:
    with (
        Scene.open(built.scene) as scene,
        terraport.sync.connect(server.scene_url("quarry")) as session,
    ):
        here, elsewhere = places(scene, 2)[:2]
        session.land(here, radius_m=40.0).ready(timeout_s=30)
        first = session.visible_set_hash()
        session.land(elsewhere, radius_m=40.0).ready(timeout_s=30)
        again = session.land(here, radius_m=40.0)
        again.ready(timeout_s=30)
        assert again.plan.load_bytes == 0
        assert session.visible_set_hash() == first


def test_the_streamed_surface_lies_on_the_survey(
    built: Built, server: BackgroundServer, survey: Survey
) -> None:
    """A mirrored axis, a shifted origin or a swapped attribute would move these far off."""
    with Scene.open(built.scene) as scene:
        origin = np.array(scene.manifest.origin)
        spacing_m = float(np.sqrt(np.ptp(survey.points[:, 0]) * np.ptp(survey.points[:, 1]) / 2e4))
    with terraport.sync.connect(server.scene_url("quarry")) as session:
        meshes = [s.arrays() for s in session.land((0, 0, 0), radius_m=400).ready(timeout_s=60)]
    positions = to_crs(np.concatenate([mesh.positions for mesh in meshes]), origin)
    distance_m, nearest = cKDTree(positions).query(survey.points[::7])
    assert np.median(distance_m) < spacing_m
    assert np.quantile(distance_m, 0.95) < 2 * spacing_m
    colours = np.concatenate([mesh.colours for mesh in meshes])[nearest].astype(int)
    assert np.median(np.abs(colours - survey.colours[::7])) < 12
    grade = np.concatenate([mesh.attributes["grade"] for mesh in meshes])[nearest]
    spread = float(np.std(survey.attributes["grade"]))
    assert np.median(np.abs(grade - survey.attributes["grade"][::7])) < 0.1 * spread


def test_a_known_point_is_found_again(tmp_path: Path, survey: Survey) -> None:
    """Survey points as the mesh's own vertices: what is left is the error of the whole chain."""
    # A mesh whose vertices are survey points: no reconstruction, so no error of its own.
    points = survey.points[:10_000]
    origin = np.floor(points.min(axis=0))
    flat = Delaunay(points[:, :2] - origin[:2]).simplices.astype(np.int32)
    mesh = Mesh(
        vertices=to_scene(points, origin),
        faces=flat,
        normals=np.tile(np.float32([0, 1, 0]), (len(points), 1)),
        colours=survey.colours[:10_000],
        attributes={"grade": survey.attributes["grade"][:10_000]},
    )
    runner = runner_in(tmp_path / "build")
    surface = surface_in_tiles(mesh, mesh, (0.0, 0.0, 0.0, 0.0))
    about = pack.About(
        origin=origin,
        crs=None,
        points=len(points),
        has_colour=True,
        build=BuildInfo(
            terraport="test",
            options={},
            input=InputInfo(name="quarry.laz", bytes=1, xxh3="0" * 16),
            warnings=(),
        ),
    )
    publish_tiles(
        runner, tmp_path / "known", surface, segment_tiles(runner, surface, segment.Options()),
        None, None, about, pack.Options(name="known"),
    )  # fmt: skip
    # Through the service and the SDK, back to the survey's coordinates.
    with BackgroundServer(tmp_path) as server:
        url = server.scene_url("known")
        with terraport.sync.connect(url) as session:
            manifest = session.manifest()
            meshes = [s.arrays() for s in session.land((0, 0, 0), radius_m=450).ready(timeout_s=60)]
    positions = to_crs(np.concatenate([m.positions for m in meshes]), np.array(manifest["origin"]))
    # Positions: at most the millimetre of the survey file and one step of the scene's grid.
    used = np.unique(flat)
    distance_m, nearest = cKDTree(positions).query(points[used])
    assert distance_m.max() <= 0.001 + manifest["step_m"]
    # Colours and attributes: only where no other survey point shares the grid cell.
    close = cKDTree(positions).query_ball_point(points[used], manifest["step_m"])
    alone = np.array([len(neighbours) <= 4 for neighbours in close])
    colours = np.concatenate([m.colours for m in meshes])[nearest]
    np.testing.assert_array_equal(colours[alone], survey.colours[used][alone])
    grade = np.concatenate([m.attributes["grade"] for m in meshes])[nearest]
    (scale,) = manifest["attributes"]
    np.testing.assert_allclose(
        grade[alone], survey.attributes["grade"][used][alone], atol=scale["step"]
    )


def test_validate_finds_a_fresh_scene_good_and_a_damaged_one_bad(built: Built) -> None:
    good = run_terraport("validate", built.scene, "--rays", "60000", "--subsets", "10")
    assert good.returncode == 0, good.stdout + good.stderr
    pack_file = next(built.scene.glob("v-*/segments.pack"))
    original = pack_file.read_bytes()
    try:
        middle = len(original) // 2
        flipped = bytes([original[middle] ^ 0x10])
        pack_file.write_bytes(original[:middle] + flipped + original[middle + 1 :])
        bad = run_terraport("validate", built.scene, "--rays", "60000", "--subsets", "10")
        assert bad.returncode == 1
        assert "segments.pack" in bad.stdout + bad.stderr
    finally:
        pack_file.write_bytes(original)


def test_khronos_finds_no_error_in_a_fresh_scene(built: Built) -> None:
    done = run_terraport("validate", built.scene, "--rays", "0", "--khronos", "--json")
    gltf = json.loads(done.stdout)["gltf"]
    if gltf["not_run"]:
        pytest.skip(gltf["not_run"])
    assert (done.returncode, gltf["errors"], gltf["messages"]) == (0, 0, [])
    assert gltf["checked"] > 10


def test_another_build_gives_the_same_bytes(built: Built, tmp_path: Path) -> None:
    """Another folder, another work directory, one thread: the scene is the same, byte for byte."""
    other = tmp_path / "quarry"
    done = run_terraport("build", built.survey, "-o", other, *BUILD, "--threads", "1")
    assert done.returncode == 0, done.stderr
    names = sorted(
        path.relative_to(built.scene) for path in built.scene.glob("v-*/*") if path.is_file()
    )
    assert names == sorted(path.relative_to(other) for path in other.glob("v-*/*"))
    for name in [Path("scene.json"), *names]:
        assert (other / name).read_bytes() == (built.scene / name).read_bytes(), name
