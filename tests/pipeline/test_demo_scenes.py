"""The scene that comes along: whole, small, fine, where its view says, and copied whole."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import parse_qs

import pytest

from terraport_pipeline import demo_scenes
from terraport_pipeline.demo_scenes import (
    SHIPPED_ID,
    SHIPPED_VIEW,
    place_shipped_scene,
    shipped_scene,
)
from terraport_pipeline.errors import PipelineError
from terraport_store import Scene, list_building, validate_scene

MAX_BYTES = 6_000_000


def test_it_is_whole_and_within_its_size() -> None:
    folder = shipped_scene()
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= MAX_BYTES
    assert validate_scene(folder) == []
    with Scene.open(folder) as scene:
        assert scene.manifest.textures is not None
        assert scene.manifest.textures.texel_m <= 0.03


def test_the_view_stands_on_its_ground() -> None:
    fields = {name: values[0] for name, values in parse_qs(SHIPPED_VIEW).items()}
    x, y, z = map(float, fields["at"].split(","))
    assert fields["view"] == "walk"
    with Scene.open(shipped_scene()) as scene:
        low, high = scene.manifest.bounds.min, scene.manifest.bounds.max
        assert all(a < value < b for a, value, b in zip(low, (x, y, z), high, strict=True))
        assert (
            len(scene.within((x, y, z), float(fields["radius"]))) == scene.manifest.counts.segments
        )


def test_it_is_copied_whole_and_only_once(tmp_path: Path) -> None:
    scene = place_shipped_scene(tmp_path)
    assert scene == tmp_path / SHIPPED_ID
    (scene / "mark").touch()
    assert place_shipped_scene(tmp_path) == scene
    assert (scene / "mark").exists()
    assert [path.name for path in tmp_path.iterdir()] == [SHIPPED_ID]
    assert list_building(tmp_path) == []


def test_an_installation_without_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo_scenes, "__file__", str(tmp_path / "a" / "b" / "demo_scenes.py"))
    with pytest.raises(PipelineError, match="lacks the scene that comes along"):
        place_shipped_scene(tmp_path)
