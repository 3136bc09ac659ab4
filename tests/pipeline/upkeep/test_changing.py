"""Scenes moved and removed with what belongs to them, or refused whole."""

from __future__ import annotations

from pathlib import Path

import pytest
from store.tiny_scene import TinyScene, write_tiny_scene

from terraport_pipeline.errors import BuildLockedError, OptionError
from terraport_pipeline.upkeep.changing import move_scene, owned_by, remove_scene, target_of
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store import (
    PublishError,
    SceneBusyError,
    SceneNotFoundError,
    change_labels,
    read_labels,
    validate_scene,
)
from terraport_store.publishing import PublishLock


@pytest.fixture
def pit(tmp_path: Path) -> TinyScene:
    """A scene with a label, a report and a work directory of 500 bytes."""
    (tmp_path / "scenes").mkdir()
    scene = write_tiny_scene(tmp_path / "scenes" / "pit", stable_ids=(4, 2, 9))
    change_labels(scene.path, {2: "bench"})
    (scene.path / "report.html").write_text("<p>fine</p>")
    work = WorkDirectory(scene.path.parent / ".pit.work")
    (work.path / "cloud.npy").write_bytes(bytes(500))
    return scene


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_all_of_it_moves(pit: TinyScene, tmp_path: Path) -> None:
    archive = tmp_path / "archive"
    archive.mkdir()
    target = target_of(str(pit.path), str(archive))
    assert target == str(archive / "pit")
    moved = move_scene(str(pit.path), target)
    assert (moved.has_work, moved.was_copied) == (True, False)
    assert names(pit.path.parent) == []
    assert names(archive) == [".pit.work", "pit"]
    assert validate_scene(archive / "pit") == []
    assert read_labels(archive / "pit") == {2: "bench"}
    assert (archive / "pit" / "report.html").exists()
    renamed = target_of(str(archive / "pit"), str(archive / "well"))
    move_scene(str(archive / "pit"), renamed)
    assert names(archive) == [".well.work", "well"]


def test_where_a_scene_moves_to(tmp_path: Path) -> None:
    assert target_of("a/pit", str(tmp_path)) == str(tmp_path / "pit")
    assert target_of("a/pit", "a/well") == "a/well"
    assert target_of("s3://b/pit", "s3://b/old/") == "s3://b/old/pit"
    assert target_of("s3://b/pit/", "s3://b/old") == "s3://b/old"


def test_what_cannot_be_moved_stays(pit: TinyScene, tmp_path: Path) -> None:
    scenes = pit.path.parent
    well = write_tiny_scene(scenes / "well", seed=1)
    (scenes / "plain").mkdir()
    (scenes / "link").symlink_to("pit")
    WorkDirectory(scenes / ".begun.work")
    for source, target, error, text in (
        ("nothing", "x", SceneNotFoundError, "no scene at"),
        ("plain", "x", SceneNotFoundError, "no scene at"),
        ("link", "x", OptionError, "is a link, expected the scene itself"),
        ("pit", "well", PublishError, "a scene is at .*well, expected nothing"),
        ("pit", "begun", PublishError, r"\.begun\.work is there"),
        ("pit", "no/folder/x", OptionError, "there is no folder"),
        ("pit", "pit", OptionError, "are one scene"),
        ("pit", "pit/inner", OptionError, "lies in .* itself"),
        ("pit", "well/inner", OptionError, "well is a scene itself"),
    ):
        with pytest.raises(error, match=text):
            move_scene(str(scenes / source), str(scenes / target))
    with pytest.raises(OptionError, match=r"is in object storage and .* on this machine"):
        move_scene(str(pit.path), "s3://scenes/pit")
    assert validate_scene(pit.path) == validate_scene(well.path) == []
    assert names(scenes) == [".begun.work", ".pit.work", "link", "pit", "plain", "well"]


@pytest.mark.parametrize("built", ["pit", "well"])
def test_neither_is_touched_while_a_build_runs(pit: TinyScene, built: str) -> None:
    target = pit.path.with_name("well")
    with scene_locked(target.with_name(built)), pytest.raises(BuildLockedError):
        move_scene(str(pit.path), str(target))
    with scene_locked(pit.path), pytest.raises(BuildLockedError):
        remove_scene(str(pit.path), only_work=False)
    lock = PublishLock(pit.path)
    with pytest.raises(SceneBusyError):
        move_scene(str(pit.path), str(target))
    lock.release()
    assert validate_scene(pit.path) == []
    assert names(pit.path.parent) == [".pit.work", "pit"]


def test_a_removal_takes_all_and_counts_it(pit: TinyScene) -> None:
    owned = owned_by(str(pit.path), only_work=False)
    assert owned.work_bytes == 500
    freed = remove_scene(str(pit.path), only_work=False)
    assert freed == owned.scene_bytes + 500
    assert names(pit.path.parent) == []


def test_only_the_work(pit: TinyScene) -> None:
    assert remove_scene(str(pit.path), only_work=True) == 500
    assert names(pit.path.parent) == ["pit"]
    assert validate_scene(pit.path) == []
    with pytest.raises(OptionError, match="has no work directory"):
        remove_scene(str(pit.path), only_work=True)
    # An unfinished build has no scene yet.
    WorkDirectory(pit.path.with_name(".begun.work"))
    remove_scene(str(pit.path.with_name("begun")), only_work=True)
    assert names(pit.path.parent) == ["pit"]


def test_what_is_no_scene_is_never_removed(pit: TinyScene, tmp_path: Path) -> None:
    scenes = pit.path.parent
    plain = tmp_path / "plain"
    plain.mkdir()
    (plain / "a").touch()
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "scene.json").write_text('{"metadata": {"type": "Scene"}}')
    for path in (scenes, plain, tmp_path / "nothing" / "x"):
        with pytest.raises(SceneNotFoundError):
            remove_scene(str(path), only_work=False)
    with pytest.raises(Exception, match=r"scene\.json: format None"):
        remove_scene(str(foreign), only_work=False)
    (pit.path / "notes.txt").touch()
    with pytest.raises(OptionError, match=r"holds other files \(notes\.txt\)"):
        remove_scene(str(pit.path), only_work=False)
    with pytest.raises(OptionError, match="no work in object storage"):
        remove_scene("s3://b/pit", only_work=True)
    assert validate_scene(pit.path) == []
    assert (foreign / "scene.json").exists()
    assert (plain / "a").exists()


def test_a_damaged_scene_can_be_removed(pit: TinyScene) -> None:
    (pit.path / "scene.json").write_text("{")
    remove_scene(str(pit.path), only_work=False)
    assert names(pit.path.parent) == []
