"""The input's points are found in the work directory, and only if they belong to the scene."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.report.input_cloud import find_input_cloud, read_input_cloud
from terraport_store import Scene

COUNT = 123_456


@pytest.fixture
def scene_dir(scene_path, tmp_path):
    """A scene with a work directory beside it."""
    copy = shutil.copytree(scene_path, tmp_path / "ground")
    folder = tmp_path / ".ground.work" / "clean"
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    np.save(folder / "points.npy", rng.uniform(0, 100, (COUNT, 3)).astype(np.float32))
    np.save(folder / "colours.npy", rng.integers(0, 255, (COUNT, 3), dtype=np.uint8))
    np.save(folder / "origin.npy", np.array([500_000.0, 6_000_000.0, 120.0]))
    (folder / "stage.json").write_text(json.dumps({"values": {"spacing_m": 0.25}}))
    return copy


def test_points_are_found_beside_the_scene(scene_dir) -> None:
    with Scene.open(scene_dir) as scene:
        cloud = find_input_cloud(scene)
    assert cloud is not None
    assert (cloud.total, len(cloud.points), cloud.spacing_m) == (COUNT, COUNT, 0.25)


def test_points_as_they_were_read_are_taken_if_they_are_this_scene_s(scene_dir) -> None:
    """The manifest has the first digits of the read stage's digest."""
    folder = scene_dir.parent / ".ground.work" / "read"
    folder.mkdir()
    np.save(folder / "points.npy", np.array([[500_010.0, 6_000_020.0, 130.0]] * 5))
    for digest, read in (("0" * 32, 5), ("1" * 32, 0), (None, 0)):
        (folder / "stage.json").write_text(json.dumps({"digest": digest}))
        with Scene.open(scene_dir) as scene:
            cloud = find_input_cloud(scene)
        assert cloud is not None
        assert cloud.read == read
        assert (cloud.surveyed is None) == (read == 0)
        if cloud.surveyed is not None:
            assert cloud.surveyed[0].tolist() == [10.0, 10.0, -20.0]


def test_the_survey_itself_is_read_again(scene_path, tmp_path) -> None:
    rng = np.random.default_rng(3)
    rows = rng.uniform(0, 100, (500, 3)) + np.array([500_000, 5_999_900, 120])
    survey = tmp_path / "pit.xyz"
    np.savetxt(survey, rows, fmt="%.3f")
    with Scene.open(scene_path) as scene:
        cloud = read_input_cloud(scene, survey)
        assert (cloud.total, cloud.read, len(cloud.points)) == (500, 500, 500)
        assert cloud.surveyed is cloud.points
        np.testing.assert_allclose(
            np.sort(cloud.points[:, 0]), np.sort(rows[:, 0] - 500_000), atol=1e-3
        )
        np.savetxt(survey, rows + np.array([90_000, 0, 0]), fmt="%.3f")
        with pytest.raises(OptionError, match="lies elsewhere than the scene rolling <ground>"):
            read_input_cloud(scene, survey)


def test_large_clouds_are_thinned(scene_dir, monkeypatch) -> None:
    monkeypatch.setattr("terraport_pipeline.report.input_cloud.MAX_POINTS", 40_000)
    with Scene.open(scene_dir) as scene:
        cloud = find_input_cloud(scene)
    assert cloud is not None
    assert len(cloud.points) == len(cloud.colours) == -(-COUNT // 4)
    assert (cloud.total, cloud.spacing_m) == (COUNT, 0.5)


def test_a_build_by_tiles_left_a_thinned_copy(scene_dir) -> None:
    work = scene_dir.parent / ".ground.work"
    np.save(work / "clean" / "points.npy", np.zeros((1000, 3), np.float32))
    np.save(work / "clean" / "colours.npy", np.zeros((1000, 3), np.uint8))
    for tile, count in enumerate((100_000, 0, COUNT - 100_000)):
        record = work / f"solve-{tile:05d}" / "stage.json"
        record.parent.mkdir()
        record.write_text(json.dumps({"values": {"core": count}}))
    with Scene.open(scene_dir) as scene:
        cloud = find_input_cloud(scene)
        assert cloud is not None
        assert (cloud.total, len(cloud.points), cloud.spacing_m) == (COUNT, 1000, 0.25)
        for damaged in ({"values": {"core": 1}}, {"values": {}}, {"values": {"core": "many"}}):
            record.write_text(json.dumps(damaged))
            assert find_input_cloud(scene) is None


@pytest.mark.parametrize("damage", ["gone", "truncated", "other origin", "other count", "record"])
def test_what_is_damaged_or_another_builds_is_left(scene_dir, damage) -> None:
    folder = scene_dir.parent / ".ground.work" / "clean"
    if damage == "gone":
        shutil.rmtree(folder)
    elif damage == "truncated":
        data = (folder / "points.npy").read_bytes()
        (folder / "points.npy").write_bytes(data[: len(data) // 2])
    elif damage == "other origin":
        np.save(folder / "origin.npy", np.zeros(3))
    elif damage == "other count":
        np.save(folder / "points.npy", np.zeros((5, 3), np.float32))
    else:
        (folder / "stage.json").write_text("{}")
    with Scene.open(scene_dir) as scene:
        assert find_input_cloud(scene) is None
