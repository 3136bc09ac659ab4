"""A scene's folder as a whole: there for readers or not, and never half of it."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest
from store.tiny_scene import TinyScene

from terraport_store import OutOfSpaceError, PublishError, list_scenes, validate_scene
from terraport_store import scene_folder as scene_folder_module
from terraport_store.scene_folder import (
    folder_bytes,
    foreign_entries,
    move_folder,
    remove_folder,
    sweep_unfinished,
)


@pytest.fixture
def two_disks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that nothing is renamed into from outside, as another disk."""
    other = tmp_path / "other"
    other.mkdir()
    rename = Path.rename

    def renamed(self: Path, target: Any) -> Path:
        if (other in Path(target).parents) != (other in self.parents):
            raise OSError(errno.EXDEV, "Invalid cross-device link", str(self))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", renamed)
    return other


def test_what_is_none_of_a_scene(tiny: TinyScene) -> None:
    for own in ("labels.json", "build.json", "report.html", "report.pdf", ".v-0123.tmp"):
        (tiny.path / own).touch()
    assert foreign_entries(tiny.path) == []
    (tiny.path / "notes.txt").touch()
    (tiny.path / "v-old").mkdir()
    assert foreign_entries(tiny.path) == ["notes.txt", "v-old"]


def test_a_removal_counts_and_leaves_nothing(tiny: TinyScene) -> None:
    files = sum(file.bytes for file in tiny.manifest.files.values())
    size = folder_bytes(tiny.path)
    assert size == files + (tiny.path / "scene.json").stat().st_size
    assert remove_folder(tiny.path) == size
    assert list(tiny.path.parent.iterdir()) == []


def test_a_removal_that_was_killed_is_no_scene_and_is_swept(
    tiny: TinyScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(_path: Path, **_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(scene_folder_module.shutil, "rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            remove_folder(tiny.path)
    assert list_scenes(tiny.path.parent) == {}
    assert sweep_unfinished(tiny.path.with_name("tin")) == 0
    assert sweep_unfinished(tiny.path) > 0
    assert list(tiny.path.parent.iterdir()) == []


def test_a_move_within_a_disk_is_a_rename(tiny: TinyScene) -> None:
    inode = (tiny.path / "scene.json").stat().st_ino
    target = tiny.path.with_name("pit")
    assert not move_folder(tiny.path, target)
    assert (target / "scene.json").stat().st_ino == inode
    assert not tiny.path.exists()
    with pytest.raises(PublishError, match="exists, expected nothing there"):
        move_folder(target, target.parent)


def test_a_move_to_another_disk_is_a_whole_copy(tiny: TinyScene, two_disks: Path) -> None:
    (tiny.path / "link").symlink_to("scene.json")
    written_ns = (tiny.path / "scene.json").stat().st_mtime_ns
    copied: list[int] = []
    size = folder_bytes(tiny.path)
    assert move_folder(tiny.path, two_disks / "pit", copied.append)
    assert not tiny.path.exists()
    assert [path.name for path in two_disks.iterdir()] == ["pit"]
    assert validate_scene(two_disks / "pit") == []
    assert (two_disks / "pit" / "scene.json").stat().st_mtime_ns == written_ns
    assert (two_disks / "pit" / "link").is_symlink()
    assert 0 < sum(copied) <= size


def test_a_copy_that_fails_leaves_the_scene_where_it_was(
    tiny: TinyScene, two_disks: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(scene_folder_module.os, "fsync", full)
        with pytest.raises(OutOfSpaceError):
            move_folder(tiny.path, two_disks / "pit")
    assert list(two_disks.iterdir()) == []
    assert validate_scene(tiny.path) == []
