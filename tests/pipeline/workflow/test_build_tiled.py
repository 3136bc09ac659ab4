"""Everything after the reconstruction by tiles: one scene, whatever the threads and kills."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from coloured_ground import cut_mesh, ground
from memory_tiles import MemoryTiles
from pipeline.one_piece import runner_in, surface_in_tiles

from terraport_pipeline.model import Mesh
from terraport_pipeline.options import regions as segment
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.stages import pack
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions
from terraport_pipeline.workflow import segment_step
from terraport_pipeline.workflow.pack_step import publish_tiles
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_store import BuildInfo, InputInfo, Scene
from terraport_store.validate import validate_scene

SEGMENT = segment.Options(min_faces=150, max_faces=900)
BUILD = BuildInfo(
    terraport="0", options={}, input=InputInfo(name="a.laz", bytes=1, xxh3="0" * 16),
    warnings=(), stages=(),
)  # fmt: skip


@pytest.fixture(scope="module")
def detail() -> Mesh:
    return ground(80)


def surface_of(detail: Mesh, along: int) -> Surface:
    base = ground(16, low=-3.0, high=63.0)
    return surface_in_tiles(base, detail, (0.1, 0.2, 0.5, 0.6), along=along)


def build(folder: Path, surface: Surface, *, threads: int = 2, options=SEGMENT) -> Runner:
    runner = runner_in(folder, threads=threads, max_memory_bytes=2**31)
    segmented = segment_tiles(runner, surface, options)
    about = pack.About(np.array([500000.0, 8e6, 100.0]), None, 99, True, BUILD)
    publish_tiles(
        runner, folder / "scene", surface, segmented, None, None, about, pack.Options("ground")
    )
    return runner


def published(folder: Path) -> dict[str, bytes]:
    with Scene.open(folder / "scene") as opened:
        return {
            key: (opened.path / file.path).read_bytes()
            for key, file in opened.manifest.files.items()
        }


@pytest.fixture(scope="module")
def scene(detail, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("tiled")
    build(folder, surface_of(detail, 3))
    return folder


def test_the_scene_is_whole_and_has_no_hole(scene, detail) -> None:
    assert list(validate_scene(scene / "scene")) == []
    with Scene.open(scene / "scene") as opened:
        assert int(opened.index.face_count.sum()) == len(detail.faces)
        assert opened.manifest.counts.points == 99
        report = check_hand_off(
            load_scene_model(opened).hand_off_model(), HandOffOptions(20_000, 20)
        )
    assert report.holes == 0
    assert report.hits > 15_000


def test_regions_are_the_stripes_and_run_through_all_tiles(scene) -> None:
    with Scene.open(scene / "scene") as opened:
        regions = opened.regions["regions"]
        index = opened.index
    assert len(regions) == 3
    assert sum(row["faces"] for row in regions) == int(index.face_count.sum())
    widest = max(row["bounds"]["max"][2] - row["bounds"]["min"][2] for row in regions)
    assert widest > 55.0  # the square is 60 m wide, a tile 20
    assert [row["stable_id"] for row in regions] == [0, 1, 2]


def test_segments_keep_their_bounds_and_lie_along_one_curve(scene) -> None:
    from terraport_pipeline.geometry.mesh.curve import morton_codes

    with Scene.open(scene / "scene") as opened:
        index = opened.index
        assert int(index.face_count.max()) <= 900
        assert (index.face_count >= 150).mean() > 0.9
        middle = (index.bounds[:, :3] + index.bounds[:, 3:]) / 2
        # Boxes of payloads are rounded to the grid: neighbours on the curve may change places.
        codes = morton_codes(middle).astype(np.float64)
        assert np.corrcoef(np.argsort(np.argsort(codes)), np.arange(len(codes)))[0, 1] > 0.999
        mesh = opened.mesh(0)
        assert np.nanmax(np.abs(mesh.attributes["height"] - mesh.positions[:, 1])) < 2e-3


def test_threads_change_nothing(scene, detail, tmp_path) -> None:
    build(tmp_path, surface_of(detail, 3), threads=1)
    assert published(tmp_path) == published(scene)


def test_a_build_that_was_killed_goes_on_with_the_tile_it_was_at(
    scene, detail, tmp_path, monkeypatch
) -> None:
    surface = surface_of(detail, 3)
    whole, seen = segment_step.tiled_segment.cut, []

    def dies(mesh, *arguments, **named):
        if len(seen) == 4:
            raise KeyboardInterrupt
        seen.append(len(mesh.faces))
        return whole(mesh, *arguments, **named)

    monkeypatch.setattr(segment_step.tiled_segment, "cut", dies)
    with pytest.raises(KeyboardInterrupt):
        build(tmp_path, surface, threads=1)
    assert not (tmp_path / "scene").exists()
    monkeypatch.setattr(segment_step.tiled_segment, "cut", whole)
    again = []
    monkeypatch.setattr(
        segment_step.tiled_segment, "cut",
        lambda mesh, *a, **n: again.append(1) or whole(mesh, *a, **n),
    )  # fmt: skip
    build(tmp_path, surface, threads=1)
    assert (len(seen), len(again)) == (4, 5)
    assert published(tmp_path) == published(scene)


def test_the_same_again_publishes_nothing(scene, detail) -> None:
    before = (scene / "scene" / "scene.json").stat().st_mtime_ns
    runner = build(scene, surface_of(detail, 3))
    assert [(report.name, report.taken_up) for report in runner.reports] == [
        ("segment", True),
        ("pack", True),
    ]
    assert (scene / "scene" / "scene.json").stat().st_mtime_ns == before


def test_a_second_version_keeps_the_regions_numbers(scene, detail, tmp_path) -> None:
    build(tmp_path, surface_of(detail, 3))
    other = segment.Options(min_faces=200, max_faces=1200)
    build(tmp_path, surface_of(detail, 2), options=other)
    assert list(validate_scene(tmp_path / "scene")) == []
    with Scene.open(tmp_path / "scene") as opened:
        assert sorted(row["stable_id"] for row in opened.regions["regions"]) == [0, 1, 2]


def test_crumbs_of_tiles_do_no_harm(detail, tmp_path) -> None:
    piece = cut_mesh(detail, 2)[0][0]
    first_face, rest = piece.faces[:1], piece.faces[1:]
    crumb = Mesh(
        piece.vertices[first_face[0]], np.array([[0, 1, 2]], np.int32),
        piece.normals[first_face[0]], piece.colours[first_face[0]],
        {"height": np.full(3, np.nan, np.float32)},
    )  # fmt: skip
    others = tuple(tile for tile, _ in cut_mesh(detail, 2)[1:])
    whole = Mesh(piece.vertices, rest, piece.normals, piece.colours, piece.attributes)
    tiles = MemoryTiles(
        (crumb, whole, *others), (), (), np.zeros(0, bool), ("height",), "crumbs", tuple("0123456")
    )
    crumbs = replace(surface_of(detail, 2), tiles=tiles, digest="crumbs")
    build(tmp_path, crumbs)
    assert list(validate_scene(tmp_path / "scene")) == []
    with Scene.open(tmp_path / "scene") as opened:
        assert int(opened.index.face_count.sum()) == len(detail.faces)
        assert len(opened.regions["regions"]) == 3
