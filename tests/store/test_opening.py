"""Steps of opening a scene that are used on their own; the rest is in test_reader.py."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from store.tiny_scene import TinyScene

from terraport_store import SceneNotFoundError, list_scenes, read_manifest


def test_no_folder_no_scenes(tmp_path: Path) -> None:
    with pytest.raises(SceneNotFoundError):
        list_scenes(tmp_path / "nothing")


def test_list_scenes(tmp_path: Path, tiny: TinyScene) -> None:
    root = tmp_path / "root"
    root.mkdir()
    for name in ("b", "a", ".hidden"):
        shutil.copytree(tiny.path, root / name)
    (root / "no-scene").mkdir()
    (root / "file").write_text("x")
    assert list_scenes(root) == {"a": root / "a", "b": root / "b"}
    assert list(list_scenes(root)) == ["a", "b"]
    assert list_scenes(tiny.path) == {"tiny": tiny.path}
    with pytest.raises(SceneNotFoundError, match=r"; scenes in it: a, b$"):
        read_manifest(root)
