"""The proof of levels, on a scene where it must find nothing and on one with a gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from server.grid_scene import GridScene, write_grid_scene

import terraport_pipeline.validate.level_mixes as level_mixes
from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.validate.level_mixes import check_level_mixes
from terraport_pipeline.validate.scene_windows import scene_windows
from terraport_store import Scene


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("mixes") / "two", cells=24, levels=2)


@pytest.fixture(autouse=True)
def whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Load every segment in all mixes: the base of this scene is far from its detail."""

    def all_loaded(centres: Float64, count: int, _rng: np.random.Generator) -> Bool:
        return np.ones((count, len(centres)), np.bool_)

    monkeypatch.setattr(level_mixes, "random_subsets", all_loaded)


def test_no_mix_of_levels_has_a_hole(two: GridScene) -> None:
    with Scene.open(two.path) as scene:
        report = check_level_mixes(scene, rays=40_000, mixes=12)
    assert (report.rays, report.mixes, report.holes) == (40_000, 12, 0)
    assert report.hits > 30_000


def test_a_gap_beside_the_coarser_level_is_found(
    two: GridScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The coarser level of one segment, without the faces along one of its sides."""
    load = level_mixes._load_level

    def without_a_strip(scene: Scene, level: int, segments: Int64) -> level_mixes._Level:
        whole = load(scene, level, segments)
        x = whole.vertices[whole.faces][:, :, 0]
        kept = ~((whole.segment_of_face == 14) & (x.min(axis=1) < 20.05))
        return level_mixes._Level(whole.vertices, whole.faces[kept], whole.segment_of_face[kept])

    monkeypatch.setattr(level_mixes, "_load_level", without_a_strip)
    with Scene.open(two.path) as scene:
        assert scene.index.bounds[14, 0] == np.float32(20)
        report = check_level_mixes(scene, rays=40_000, mixes=12)
    assert report.holes > 0
    assert len(report.hole_places) == min(report.holes, level_mixes.MAX_HOLE_PLACES)
    assert all(20 <= x <= 30 and 20 <= z <= 30 for x, _, z in report.hole_places)


def test_a_scene_larger_than_memory_is_looked_at_in_windows(
    two: GridScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Scene.open(two.path) as scene:
        windows = scene_windows(scene, int(scene.index.face_count.sum()) // 3)
        assert len(windows) > 2
        monkeypatch.setattr(level_mixes, "scene_windows", lambda _: windows)
        report = check_level_mixes(scene, rays=10_000, mixes=12)
    assert (report.rays, report.holes) == (10_000, 0)
    assert report.mixes == len(windows) * max(6, 12 // len(windows))
    assert report.hits > 7_000


def test_a_scene_of_one_level_has_no_mixes(tmp_path: Path) -> None:
    one = write_grid_scene(tmp_path / "one")
    with Scene.open(one.path) as scene, pytest.raises(OptionError, match="one level"):
        check_level_mixes(scene, rays=100, mixes=2)
