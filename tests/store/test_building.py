"""What builds say of themselves beside their scenes, and what is made of nonsense there."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from terraport_store import SceneBuilding, end_building, list_building, list_scenes, say_building
from terraport_store.building import MAX_LISTED, SILENT_AFTER_S


def test_a_build_is_listed_until_it_ends(tmp_path: Path) -> None:
    say_building(tmp_path / "pit", "The pit", "read", None)
    say_building(tmp_path / "pit", "The pit", "pack", 0.5)
    say_building(tmp_path / "a", "A", "read", 1.0)
    assert list_building(tmp_path) == [
        SceneBuilding("a", "A", "read", 1.0),
        SceneBuilding("pit", "The pit", "pack", 0.5),
    ]
    assert list_scenes(tmp_path) == {}
    for name in ("pit", "a", "pit"):
        end_building(tmp_path / name)
    assert list_building(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_who_is_silent_for_long_was_killed(tmp_path: Path) -> None:
    say_building(tmp_path / "pit", "The pit", "read", None)
    (path,) = tmp_path.iterdir()
    past = time.time() - SILENT_AFTER_S - 5
    os.utime(path, (past, past))
    assert list_building(tmp_path) == []


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", '{"name": 1, "step": "a", "share": 0}',
        '{"name": "a", "step": "a", "share": 2}', '{"name": "a", "step": "a", "share": true}',
        '{"name": "a", "step": "a", "share": NaN}', '{"name": "a", "step": "a"}', "\xff" * 9000,
    ],
)  # fmt: skip
def test_nonsense_is_no_build(tmp_path: Path, text: str) -> None:
    (tmp_path / ".pit.building.json").write_text(text, encoding="latin-1")
    assert list_building(tmp_path) == []


def test_lists_and_texts_are_bounded(tmp_path: Path) -> None:
    for number in range(MAX_LISTED + 3):
        say_building(tmp_path / f"s{number:03}", "n" * 300, "t" * 300, 0.0)
    builds = list_building(tmp_path)
    assert len(builds) == MAX_LISTED
    assert {(len(build.name), len(build.step)) for build in builds} == {(200, 200)}


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / ".pit.building.json")
    assert list_building(tmp_path) == []


def test_a_link_is_not_followed_and_one_scene_lists_none(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(json.dumps({"name": "a", "step": "b", "share": None}))
    (tmp_path / ".pit.building.json").symlink_to(tmp_path / "secret")
    assert list_building(tmp_path) == []
    say_building(tmp_path / "a", "A", "read", None)
    (tmp_path / "scene.json").touch()
    assert list_building(tmp_path) == []
