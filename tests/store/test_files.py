"""Files of a scene, and nothing that lies beside it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from store.tiny_scene import write_tiny_scene

from terraport_store import DamagedSceneError, FolderFiles, Scene, files, open_inside, path_inside


def test_links_out_of_the_folder_lead_nowhere(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    (scene / "v").mkdir(parents=True)
    (tmp_path / "secret").write_text("beside")
    (scene / "v" / "inside").write_text("inside")
    (scene / "out").symlink_to(tmp_path / "secret")
    (scene / "up").symlink_to("..")
    (scene / "in").symlink_to("v/inside")
    (scene / "circle").symlink_to("circle")
    (tmp_path / "scene-2").mkdir()  # its path begins like the scene's
    (scene / "beside").symlink_to("../scene-2")
    for path in ("out", "up/secret", "../secret", "beside", "v/../../secret", "/etc/hostname"):
        with pytest.raises(PermissionError, match="leads out of the scene") as caught:
            path_inside(scene, path)
        assert caught.value.filename == path
    assert path_inside(scene, "in") == (scene / "v" / "inside").resolve()
    assert path_inside(scene, "none/yet") == scene.resolve() / "none" / "yet"
    files = FolderFiles(scene)
    assert files.read("in", 100) == b"inside"
    assert files.stamp("in") is not None
    assert files.stamp("out") is None
    for path in ("out", "up/secret"):
        with pytest.raises(PermissionError):
            files.read(path, 100)
        with pytest.raises(PermissionError):
            files.size(path)
    with pytest.raises(OSError, match="circle"):
        files.read("circle", 100)


def test_what_is_opened_is_a_file_of_the_folder(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    (scene / "v" / "w").mkdir(parents=True)
    (scene / "v" / "w" / "inside").write_text("inside")
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "inside").write_text("secret")
    (scene / "in").symlink_to("v/w/inside")
    (scene / "folder").symlink_to("../beside")
    os.mkfifo(scene / "pipe")
    for path in ("in", "v/w/inside"):
        with os.fdopen(open_inside(scene, path)) as file:
            assert file.read() == "inside"
    for path in ("folder/inside", "folder", "../beside/inside", "/dev/zero"):
        with pytest.raises(PermissionError, match="leads out"):
            open_inside(scene, path)
    for path in ("pipe", "v", ""):  # a pipe would be waited for
        with pytest.raises(OSError, match="no regular file"):
            open_inside(scene, path)
    with pytest.raises(FileNotFoundError):
        open_inside(scene, "v/none")
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError, match="no regular file"):
        FolderFiles(scene).read("pipe", 100)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


@pytest.mark.parametrize("swapped", ["v", "v/w"])
def test_a_link_that_is_put_there_meanwhile_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, swapped: str
) -> None:
    """Between the look at the path and the opening of the file."""
    scene, real_path = tmp_path / "scene", files.path_inside
    (scene / "v" / "w").mkdir(parents=True)
    (scene / "v" / "w" / "inside").write_text("inside")
    (tmp_path / "beside" / "w").mkdir(parents=True)
    for folder in (tmp_path / "beside", tmp_path / "beside" / "w"):
        (folder / "inside").write_text("secret")

    def slow_path(folder: Path, path: str) -> Path:
        real = real_path(folder, path)
        (scene / swapped).rename(tmp_path / "moved")
        (scene / swapped).symlink_to(tmp_path / "beside")
        return real

    monkeypatch.setattr(files, "path_inside", slow_path)
    with pytest.raises(OSError, match=r"v|w"):
        open_inside(scene, "v/w/inside")


def test_the_folder_itself_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    write_tiny_scene(tmp_path / "disk" / "scene")
    (tmp_path / "scene").symlink_to(tmp_path / "disk" / "scene")
    with Scene.open(tmp_path / "scene") as scene:
        assert scene.file_path("base.tsg").is_file()


@pytest.mark.parametrize("key", ["segments.idx", "segments.pack", "base.tsg", "base.cover"])
def test_a_scene_with_a_file_elsewhere_is_not_opened(tmp_path: Path, key: str) -> None:
    write_tiny_scene(tmp_path / "scene")
    with Scene.open(tmp_path / "scene") as scene:
        path = scene.file_path(key)
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises((PermissionError, DamagedSceneError)):
        Scene.open(tmp_path / "scene")
