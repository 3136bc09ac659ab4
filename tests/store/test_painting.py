"""Strokes on disk: several who paint at once lose nothing, and no version is touched."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from store.test_strokes import painted
from store.tiny_scene import TinyScene

from terraport_store import (
    SceneNotFoundError,
    StrokeError,
    change_strokes,
    read_strokes,
    read_taught,
    validate_scene,
    write_taught,
)
from terraport_store.publishing import PublishLock, sweep_left_overs
from terraport_store.scene_folder import foreign_entries


def test_they_are_painted_and_taken_back(tiny: TinyScene) -> None:
    assert read_strokes(tiny.path).strokes == ()
    change_strokes(tiny.path, lambda s: s.with_one(painted(1)))
    now = change_strokes(tiny.path, lambda s: s.with_one(painted(2, who="ben")))
    assert now == read_strokes(tiny.path)
    assert [one.who for one in now.strokes] == ["anna", "ben"]
    left = change_strokes(tiny.path, lambda s: s.without(painted(1).id))
    assert left.strokes == (painted(2, who="ben"),)
    assert left.revision != now.revision
    assert validate_scene(tiny.path) == []
    assert foreign_entries(tiny.path) == []


def test_of_many_at_once_none_is_lost(tiny: TinyScene) -> None:
    with ThreadPoolExecutor(8) as pool:
        for number in range(40):
            pool.submit(change_strokes, tiny.path, lambda s, n=number: s.with_one(painted(n)))
    assert {one.id for one in read_strokes(tiny.path).strokes} == {
        painted(number).id for number in range(40)
    }


def test_whoever_publishes_keeps_nobody_from_painting(tiny: TinyScene) -> None:
    lock = PublishLock(tiny.path)
    try:
        change_strokes(tiny.path, lambda s: s.with_one(painted()))
    finally:
        lock.release()
    assert len(read_strokes(tiny.path).strokes) == 1


def test_a_change_that_fails_leaves_what_was(tiny: TinyScene) -> None:
    change_strokes(tiny.path, lambda s: s.with_one(painted()))
    before = (tiny.path / "strokes.geojson").read_bytes()

    def refuse(_: object) -> object:
        raise StrokeError("no")

    with pytest.raises(StrokeError):
        change_strokes(tiny.path, refuse)  # type: ignore[arg-type]
    assert (tiny.path / "strokes.geojson").read_bytes() == before


def test_what_a_dead_painter_left_goes_and_a_publication_leaves_the_living(tiny: TinyScene) -> None:
    left_over = tiny.path / f".strokes-{'0' * 16}.tmp"
    left_over.write_bytes(b"half")
    sweep_left_overs(tiny.path)
    assert left_over.exists()
    change_strokes(tiny.path, lambda s: s.with_one(painted()))
    assert not left_over.exists()


def test_what_they_taught(tiny: TinyScene) -> None:
    assert read_taught(tiny.path) is None
    write_taught(tiny.path, b"{}")
    assert read_taught(tiny.path) == b"{}"


def test_without_a_scene_there_is_nothing_to_paint_on(tmp_path: Path) -> None:
    with pytest.raises(SceneNotFoundError):
        change_strokes(tmp_path / "none", lambda s: s.with_one(painted()))
