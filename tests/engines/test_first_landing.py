"""The first landings that the how-to pages print are in the scene of ``terraport demo``."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from engines import cores

from terraport_pipeline.demo_scenes import QUARRY_ID, SHIPPED_ID

PLACES = (
    cores.ROOT / "docs" / "how-to" / "unity.md",
    cores.ROOT / "docs" / "how-to" / "unreal.md",
    cores.ROOT / "docs" / "how-to" / "godot.md",
    cores.UNITY / "Samples~" / "FirstLanding" / "Walker.prefab",
    cores.UNITY / "Samples~" / "FirstLandingXR" / "XRWalker.prefab",
    cores.ROOT / "client_sdk" / "godot" / "example" / "first_landing.tscn",
)


@pytest.mark.parametrize("path", PLACES, ids=lambda path: path.name)
def test_the_address_is_that_of_the_demo(path: Path) -> None:
    scene_ids = re.findall(r"http://127\.0\.0\.1:8080/scenes/(\w+)", path.read_text())
    assert scene_ids in ([QUARRY_ID], [SHIPPED_ID])


def test_the_demo_is_told_that_port() -> None:
    for path in PLACES[:3]:  # by itself it takes a free one
        assert "`terraport demo --port 8080`" in path.read_text()


def test_unreals_page_counts_five_clicks() -> None:
    """Unity's are counted beside its sample."""
    text = PLACES[1].read_text()
    section = text.split("## First landing in five clicks\n")[1].split("\n## ")[0]
    assert len(re.findall(r"^1\. ", section, re.MULTILINE)) == 5
    assert "terraport demo --port 8080" in text


def test_godots_page_counts_four_clicks() -> None:
    """What *Play* opens is the scene that the page tells of."""
    section = PLACES[2].read_text().split("## First landing in four clicks\n")[1].split("\n## ")[0]
    assert len(re.findall(r"^1\. ", section, re.MULTILINE)) == 4
    project = (cores.ROOT / "client_sdk" / "godot" / "project.godot").read_text()
    main_scene = re.search(r'^run/main_scene="res://(.+)"$', project, re.MULTILINE)
    assert main_scene
    assert f"`{main_scene[1]}`" in section
