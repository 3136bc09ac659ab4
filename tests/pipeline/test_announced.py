"""A build says beside its scene how far it is, and nothing any more when it has ended."""

from __future__ import annotations

from pathlib import Path

import pytest

from terraport_pipeline import announced as module
from terraport_pipeline.announced import announced
from terraport_pipeline.progress import NullProgress
from terraport_store import SceneBuilding, list_building


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now_s = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    return now_s


def test_what_is_said_follows_the_steps_once_a_second(tmp_path: Path, clock: list[float]) -> None:
    scene = tmp_path / "pit"

    def said() -> tuple[str, float | None]:
        (build,) = list_building(tmp_path)
        assert (build.id, build.name) == ("pit", "The pit")
        return build.step, build.share

    with announced(scene, "The pit", NullProgress()) as progress:
        progress.start("read", None, "points")
        assert said() == ("read", None)
        progress.start("clean", 200, "points")
        progress.advance(50)
        assert said() == ("read", None)
        clock[0] += 1.0
        progress.advance(50)
        assert said() == ("clean", 0.5)
        clock[0] += 1.0
        progress.advance(500)  # forecasts are exceeded
        assert said() == ("clean", 1.0)
        progress.done({})
    assert list(tmp_path.iterdir()) == []


def test_it_ends_with_the_build_however_that_ends(tmp_path: Path) -> None:
    def interrupted() -> None:
        with announced(tmp_path / "a", "A", NullProgress()) as progress:
            progress.start("read", 1, "files")
            assert list_building(tmp_path) == [SceneBuilding("a", "A", "read", 0.0)]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_refuses_it_costs_the_announcement_alone(tmp_path: Path) -> None:
    with announced(tmp_path / "gone" / "a", "A", NullProgress()) as progress:
        progress.start("read", 1, "files")
        progress.done({})
