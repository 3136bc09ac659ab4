"""The registry: what is open, since when, for how long."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene

from terraport_server.errors import UnknownSceneError
from terraport_server.scenes.registry import SceneRegistry
from terraport_server.scenes.served_scene import ServedScene
from terraport_store import change_labels


def test_a_replaced_version_is_closed_with_its_last_holder(tmp_path: Path) -> None:
    published: list[ServedScene] = []

    async def story() -> None:
        first = write_grid_scene(tmp_path / "pit", cells=2).manifest.version
        registry = SceneRegistry(tmp_path, published=published.append)
        await registry.refresh()
        old = registry.get("pit")
        old.hold()
        old.hold()
        second = write_grid_scene(tmp_path / "pit", seed=1, cells=2).manifest.version
        await registry.refresh()
        assert registry.get("pit").version == second
        assert registry.get("pit", first) is old
        assert [served.version for served in published] == [second]
        old.release()
        assert not old.closed
        assert len(old.scene.payload(3)) > 0
        old.release()
        assert old.closed
        with pytest.raises(UnknownSceneError, match="no version"):
            registry.get("pit", first)
        registry.close()

    asyncio.run(story())


def test_a_touched_manifest_changes_nothing(tmp_path: Path) -> None:
    async def story() -> None:
        write_grid_scene(tmp_path / "pit", cells=2)
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        served = registry.get("pit")
        (tmp_path / "pit" / "scene.json").touch()
        await registry.refresh()
        assert registry.get("pit") is served
        assert not served.closed
        registry.close()
        assert served.closed

    asyncio.run(story())


def test_one_scene_may_be_the_directory(tmp_path: Path) -> None:
    async def story() -> None:
        write_grid_scene(tmp_path / "pit", cells=2)
        registry = SceneRegistry(tmp_path / "pit")
        await registry.refresh()
        assert registry.ids() == ["pit"]
        registry.close()

    asyncio.run(story())


def test_scenes_leave_descriptors_for_connections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """With 3,000 scenes and a limit of 2,304 open files nobody could connect any more."""

    async def story() -> None:
        for name in "abc":
            write_grid_scene(tmp_path / name, cells=2)
        packs = len(write_grid_scene(tmp_path / "d", cells=2).manifest.encodings)
        monkeypatch.setattr("terraport_server.scenes.registry.most_packs", lambda: 2 * packs)
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        assert registry.ids() == ["a", "b"]
        registry.close()

    asyncio.run(story())
    assert caplog.text.count("scene not opened") == 2


def test_lines_about_failures_are_few(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Of a pack that is gone each landing meets some segments: it was a line for each."""

    async def story() -> None:
        write_grid_scene(tmp_path / "pit", cells=2)
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        served = registry.get("pit")
        for segment in range(1000):
            served.tell_failure("segment_lost", segment, OSError("gone"), landing=f"a-{segment}")
        registry.close()

    asyncio.run(story())
    lost = [record for record in caplog.records if record.getMessage() == "segment_lost"]
    assert 1 <= len(lost) < 20
    assert lost[0].fields["segment"] == 0  # type: ignore[attr-defined]


def test_a_scene_that_cannot_be_opened_is_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> None:
        (tmp_path / "bad").mkdir()
        (tmp_path / "bad" / "scene.json").write_text("{}")
        registry = SceneRegistry(tmp_path)
        for _ in range(3):
            await registry.refresh()
        with pytest.raises(UnknownSceneError, match="no scene 'bad' here"):
            registry.get("bad")

    asyncio.run(story())
    assert [record.getMessage() for record in caplog.records] == ["scene not opened"]


def test_a_served_scene_finds_its_segments(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "pit", cells=2)
    served = ServedScene("pit", tmp_path / "pit")
    assert served.view.within((30.0, 0.0, 30.0), 1.0).tolist() == [14, 15, 20, 21]
    served.retire()


def test_new_labels_reach_every_open_version(tmp_path: Path) -> None:
    """No version is published and none is closed; the old version knows its own stable ids."""

    async def story() -> None:
        pit = tmp_path / "pit"
        write_grid_scene(pit, cells=2, stable_ids=(4, 2, 9))
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        old = registry.get("pit")
        old.hold()
        assert [old.names.label(region) for region in range(3)] == ["road", None, None]
        change_labels(pit, {2: "bench"})
        await registry.refresh()
        assert registry.get("pit") is old
        assert (old.names.stable_id(1), old.names.label(1)) == (2, "bench")
        write_grid_scene(pit, seed=1, cells=2, stable_ids=(4, 7, 9))
        await registry.refresh()
        new = registry.get("pit")
        assert new is not old
        assert new.names.label(1) is None
        change_labels(pit, {7: "pile", 9: "water"})
        await registry.refresh()
        assert [new.names.label(region) for region in range(3)] == ["road", "pile", "water"]
        assert [old.names.label(region) for region in range(3)] == ["road", "bench", "water"]
        (pit / "labels.json").unlink()
        await registry.refresh()
        assert new.names.label(2) is None
        old.release()
        registry.close()

    asyncio.run(story())


def test_damaged_labels_are_logged_once_and_those_before_stay(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> None:
        pit = tmp_path / "pit"
        write_grid_scene(pit, cells=2, stable_ids=(4, 2, 9))
        change_labels(pit, {2: "bench"})
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        (pit / "labels.json").write_text("{}")
        for _ in range(3):
            await registry.refresh()
        assert registry.get("pit").names.label(1) == "bench"
        registry.close()

    asyncio.run(story())
    errors = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert errors == ["labels not read"]


def test_a_scene_with_damaged_regions_is_served_without_names(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> None:
        write_grid_scene(tmp_path / "pit", cells=2, stable_ids=(4, 2, 9))
        path = next((tmp_path / "pit").glob("v-*/regions.json"))
        path.write_bytes(path.read_bytes().replace(b"road", b"raod"))
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        names = registry.get("pit").names
        assert (names.stable_id(0), names.label(0)) == (None, None)
        registry.close()

    asyncio.run(story())
    assert "regions not read" in [record.getMessage() for record in caplog.records]
