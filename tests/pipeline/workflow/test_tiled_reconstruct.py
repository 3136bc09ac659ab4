"""A survey in tiles becomes one surface without cracks, the same each time, and resumes."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pipeline.one_piece import ReconstructedSurvey, reconstruct_survey, runner_in

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.tiles.tile_plan import tile_shape
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.workflow import reconstruct_step, tile_ground
from terraport_pipeline.workflow.read_step import read_once
from terraport_pipeline.workflow.reconstruct_step import reconstruct_tiles
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.tile_ground import clean_thinned, prepare
from terraport_pipeline.workflow.workdir import WorkDirectory

POINTS = 10_000
OPTIONS = reconstruct.Options(base_faces=3_000, island_faces=50)


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("survey") / "quarry.las"
    write_quarry(QuarryOptions(points=POINTS, seed=4, size_m=120.0), path)
    return path


@pytest.fixture(scope="module")
def small_tiles() -> Iterator[None]:
    """Tiles of 128 cells with a core of 88, instead of the 512 and more of real ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tile_ground, "tile_shape", lambda depth: tile_shape(depth, 12.0))
        patch.setattr(reconstruct_step, "TilePool", lambda _, cluster: TilePool(0, cluster))
        yield


def build(
    survey: Path,
    work: Path,
    *,
    cluster: str | None = None,
    options: reconstruct.Options = OPTIONS,
    max_memory_bytes: int = 8 << 30,
    tiles: TileOptions | None = None,
) -> ReconstructedSurvey:
    runner = Runner(WorkDirectory(work), True, NullProgress(), 1, max_memory_bytes)
    read = read_once(runner, SurveyFiles.of(survey), max_points=None, bounded=True)
    cleaned = clean_thinned(runner, read, clean.Options())
    ground = prepare(runner, read, cleaned, clean.Options(), options, tiles or TileOptions(depth=7))
    return ReconstructedSurvey(ground, reconstruct_tiles(runner, ground, cluster))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tiled") / "work"


@pytest.fixture(scope="module")
def tiled(survey: Path, work: Path, small_tiles: None) -> ReconstructedSurvey:
    return build(survey, work)


def test_there_are_several_tiles_and_no_crack(tiled: ReconstructedSurvey) -> None:
    counts = tiled.facts.counts
    assert tiled.tiles.count >= 4
    assert counts["seam_edges"] > 100
    assert counts["seam_cracks"] == 0
    assert counts["seam_gap_p50_cells"] < 0.02


def joined_edges(tiled: ReconstructedSurvey) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All vertices by their bits, and how often each directed edge occurs."""
    meshes = [tiled.tiles.load(i) for i in range(tiled.tiles.count)]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([m.faces + f for m, f in zip(meshes, first, strict=False)])
    bits = np.ascontiguousarray(vertices).view(np.uint32)
    _, first_index, which = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    faces = which.ravel()[faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return vertices[first_index], faces, edges


def test_the_joined_surface_is_a_manifold_as_the_solver_made_it(
    tiled: ReconstructedSurvey,
) -> None:
    _, faces, edges = joined_edges(tiled)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 1  # no edge runs the same way twice: no face twice, none turned over
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    # Open edges are few, and next to none lies along a wall.
    key = {tuple(edge) for edge in unique.tolist()}
    open_edges = [edge for edge in key if edge[::-1] not in key]
    counts = tiled.facts.counts
    assert len(open_edges) < 0.1 * len(faces)
    assert counts["seam_rims"] <= 0.03 * counts["seam_edges"]


def test_shared_vertices_are_equal_to_the_last_bit(tiled: ReconstructedSurvey) -> None:
    tiles = tiled.tiles
    seen: dict[int, tuple[bytes, ...]] = {}
    shared = 0
    for i in range(tiles.count):
        mesh, border = tiles.load(i), tiles.border(i)
        assert (np.diff(border.rows) > 0).all()
        for row, number in zip(border.rows.tolist(), border.ids.tolist(), strict=True):
            bits = (
                mesh.vertices[row].tobytes(),
                mesh.normals[row].tobytes(),
                mesh.colours[row].tobytes(),
                *(values[row].tobytes() for values in mesh.attributes.values()),
            )
            shared += number in seen
            assert seen.setdefault(number, bits) == bits
        assert not np.signbit(mesh.vertices[mesh.vertices == 0]).any()
        assert np.isfinite(mesh.normals).all()
    assert shared > 100
    assert max(seen) < tiles.border_count


def test_it_lies_on_the_surface_of_the_whole(
    tiled: ReconstructedSurvey, survey: Path, tmp_path: Path
) -> None:
    one = reconstruct_survey(runner_in(tmp_path), read_survey(survey), OPTIONS)
    whole = one.detail
    assert tiled.ground.origin.tolist() == one.ground.origin.tolist()
    assert tiled.reconstructed.points == one.reconstructed.points <= POINTS
    assert tiled.facts.counts["points"] == one.facts.counts["points"]
    total = sum(tiled.tiles.face_count(i) for i in range(tiled.tiles.count))
    assert total == pytest.approx(len(whole.faces), rel=0.05)
    for i in range(tiled.tiles.count):
        mesh = tiled.tiles.load(i)
        rows = tiled.tiles.border(i).rows
        seam = distances_to_mesh(mesh.vertices[rows], whole.vertices, whole.faces, workers=1)
        every = distances_to_mesh(mesh.vertices[::7], whole.vertices, whole.faces, workers=1)
        # A margin of 12 cells instead of 40: the pieces follow the whole less closely.
        assert np.median(every) < 0.05 * tiled.cell_m
        assert np.percentile(every, 90) < 0.4 * tiled.cell_m
        if len(rows):
            assert np.percentile(seam, 90) < 0.4 * tiled.cell_m


def test_the_base_is_light_and_near(tiled: ReconstructedSurvey) -> None:
    assert 1_000 < len(tiled.base.faces) <= 1.2 * OPTIONS.base_faces
    assert tiled.deviation_m[2] < 2 * tiled.cell_m
    assert tuple(tiled.base.attributes) == tiled.tiles.attributes == ("grade",)


def seen_through(tiled: ReconstructedSurvey) -> float:
    """Share of the detail's own border that no base lies above or below."""
    places, faces, edges = joined_edges(tiled)
    key = edges[:, 0] * len(places) + edges[:, 1]
    back = edges[:, 1] * len(places) + edges[:, 0]
    rim = np.unique(edges[~np.isin(back, key)])
    rays = RayScene(tiled.base.vertices, tiled.base.faces, threads=1)
    start = places[rim] + np.array([0.0, 500.0, 0.0])
    distance, _ = rays.closest_hit(start, np.tile([0.0, -1.0, 0.0], (len(rim), 1)))
    assert len(faces) > len(rim) > 100
    return float(np.isinf(distance).mean())


def test_the_base_reaches_beyond_the_detail(tiled: ReconstructedSurvey) -> None:
    assert seen_through(tiled) == 0


def test_a_base_by_poisson_lies_under_the_detail_too(
    tiled: ReconstructedSurvey, survey: Path, work: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "work"
    shutil.copytree(work, copy)
    other = dataclasses.replace(OPTIONS, base_from="poisson", base_depth=6)
    solved = build(survey, copy, options=other)
    assert solved.facts.counts["base_from"] == "poisson"
    assert solved.facts.counts["base_depth"] == 6
    assert solved.digest != tiled.digest
    assert 500 < len(solved.base.faces) <= 1.2 * OPTIONS.base_faces
    assert seen_through(solved) == 0
    assert tiled.deviation_m[1] < solved.deviation_m[1] < 8 * tiled.cell_m


def test_nothing_is_done_twice_and_a_lost_tile_is_made_again(
    tiled: ReconstructedSurvey, survey: Path, work: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "work"
    shutil.copytree(work, copy)
    shutil.rmtree(copy / "solve-00001")
    shutil.rmtree(copy / "tile-00000")
    (copy / "tile-00002" / "faces.npy").write_bytes(b"cut short")
    before = {p.parent.name: p.stat().st_mtime_ns for p in copy.glob("*/stage.json")}
    again = build(survey, copy)
    after = {p.parent.name: p.stat().st_mtime_ns for p in copy.glob("*/stage.json")}
    changed = {name for name in after if after[name] != before.get(name)}
    assert changed == {"solve-00001", "tile-00000", "tile-00002"}
    assert again.digest == tiled.digest


def test_a_cluster_makes_the_same_bytes(
    tiled: ReconstructedSurvey, survey: Path, work: Path, tmp_path: Path
) -> None:
    distributed = pytest.importorskip(
        "distributed", reason="Dask is not installed (terraport[cluster])"
    )
    copy = tmp_path / "work"
    shutil.copytree(work, copy)
    for name in ("solve-00000", "solve-00003", "join", "tile-00000", "tile-00001"):
        shutil.rmtree(copy / name)
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        again = build(survey, copy, cluster=cluster.scheduler_address)
    assert again.digest == tiled.digest


def test_a_plan_that_does_not_fit_is_refused(survey: Path, work: Path, tmp_path: Path) -> None:
    copy = tmp_path / "work"
    shutil.copytree(work, copy, ignore=shutil.ignore_patterns("solve-*", "tile-*"))
    with pytest.raises(ResourceError, match=r"0\.2 GiB are too little even for the smallest tile"):
        build(survey, copy, max_memory_bytes=256 << 20, tiles=TileOptions())


def test_options_are_checked() -> None:
    with pytest.raises(OptionError, match="tile depth 6; expected 7 to 12"):
        TileOptions(depth=6)
    assert dataclasses.asdict(TileOptions())["cluster"] is None
