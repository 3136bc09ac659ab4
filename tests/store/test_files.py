"""Files of a scene, and nothing that lies beside it."""

from __future__ import annotations

from pathlib import Path

import pytest
from store.tiny_scene import write_tiny_scene

from terraport_store import DamagedSceneError, FolderFiles, Scene, path_inside


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


def test_the_folder_itself_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    write_tiny_scene(tmp_path / "disk" / "scene")
    (tmp_path / "scene").symlink_to(tmp_path / "disk" / "scene")
    with Scene.open(tmp_path / "scene") as scene:
        assert scene.file_path("base.glb").is_file()


@pytest.mark.parametrize("key", ["segments.idx", "segments.pack", "base.glb", "base.cover"])
def test_a_scene_with_a_file_elsewhere_is_not_opened(tmp_path: Path, key: str) -> None:
    write_tiny_scene(tmp_path / "scene")
    with Scene.open(tmp_path / "scene") as scene:
        path = scene.file_path(key)
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises((PermissionError, DamagedSceneError)):
        Scene.open(tmp_path / "scene")
