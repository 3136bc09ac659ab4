"""Setting labels: all or none, in one step, without touching a version."""

from __future__ import annotations

from pathlib import Path

import pytest
from store.test_publishing import run_killer
from store.tiny_scene import write_tiny_scene

import terraport_store.labelling
from terraport_store import (
    DamagedSceneError,
    LabelError,
    SceneBusyError,
    SceneNotFoundError,
    SceneWriter,
    change_labels,
    read_labels,
    read_names,
    validate_scene,
)

IDS = (4, 2, 9)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_tiny_scene(tmp_path / "s", stable_ids=IDS).path


def contents(scene: Path) -> dict[str, tuple[int, int]]:
    return {
        path.relative_to(scene).as_posix(): (path.stat().st_mtime_ns, path.stat().st_ino)
        for path in scene.rglob("*")
        if path.is_file() and path.name != "labels.json"
    }


def test_labels_are_set_changed_and_taken_away(scene: Path) -> None:
    before = contents(scene)
    assert read_labels(scene) == {}
    change_labels(scene, {9: "road", 4: "pile"})
    names = change_labels(scene, {9: "haul road", 2: "water"})
    assert names.labels == {2: "water", 4: "pile", 9: "haul road"} == read_labels(scene)
    assert [names.label(region) for region in range(3)] == ["pile", "water", "haul road"]
    assert read_labels(scene) == dict(read_names(scene)[0].labels)
    assert change_labels(scene, {2: None}).label(1) == "bench", "what the build calls it"
    assert contents(scene) == before, "no file of the version was touched"
    assert validate_scene(scene) == []


def test_nothing_is_written_where_nothing_changes(scene: Path) -> None:
    change_labels(scene, {})
    assert not (scene / "labels.json").exists()
    change_labels(scene, {4: "pile"})
    inode = (scene / "labels.json").stat().st_ino
    change_labels(scene, {4: "pile", 2: None})
    assert (scene / "labels.json").stat().st_ino == inode


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({4: "ok", 3: "x"}, r"stable id 3, expected one of the 3 of the published version"),
        ({4: "ok", 2: "x" * 257}, "stable id 2: a label of 257 characters"),
        ({4: "ok", 2: "a\tb"}, r"stable id 2: a label with the control character U\+0009"),
    ],
)
def test_one_bad_row_and_none_is_set(
    scene: Path, changes: dict[int, str | None], text: str
) -> None:
    change_labels(scene, {4: "before"})
    with pytest.raises(LabelError, match=text):
        change_labels(scene, changes)
    assert read_labels(scene) == {4: "before"}
    assert not [path for path in scene.iterdir() if path.name.startswith(".")]


def test_a_scene_without_stable_ids_is_to_be_built_again(tmp_path: Path) -> None:
    old = write_tiny_scene(tmp_path / "old").path
    with pytest.raises(LabelError, match="gives no stable ids; build the scene again"):
        change_labels(old, {0: "x"})
    with pytest.raises(SceneNotFoundError):
        change_labels(tmp_path, {0: "x"})


def test_labels_outlive_their_region(scene: Path) -> None:
    """A label of a region that is gone is kept for sessions of the version before."""
    change_labels(scene, {4: "pile", 2: "water"})
    write_tiny_scene(scene, seed=1, stable_ids=(4, 7, 9))
    names = change_labels(scene, {7: "new"})
    assert read_labels(scene) == {2: "water", 4: "pile", 7: "new"}
    assert names.without_region() == {2: "water"}
    assert validate_scene(scene) == []
    with pytest.raises(LabelError, match="stable id 2, expected one of the 3"):
        change_labels(scene, {2: "x"})


def test_the_oldest_go_first_where_there_is_no_room(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change_labels(scene, {4: "pile", 2: "water", 9: "road"})
    write_tiny_scene(scene, seed=1, stable_ids=(5, 7, 9))
    monkeypatch.setattr(terraport_store.labelling, "MAX_LABELS", 3)
    assert dict(change_labels(scene, {7: "new"}).labels) == {4: "pile", 7: "new", 9: "road"}


def test_labelling_and_publishing_exclude_each_other(scene: Path) -> None:
    with SceneWriter(scene), pytest.raises(SceneBusyError, match="another process is publishing"):
        change_labels(scene, {4: "x"})
    assert read_labels(scene) == {}


def test_killed_at_every_file_system_act(tmp_path: Path) -> None:
    """Kill -9 before the 1st, 2nd, ... act: the old labels or the new ones, whole, always."""
    answers = run_killer(tmp_path / "s", "labels")
    killed = [answer for answer in answers if answer["killed"]]
    assert len(killed) >= 5
    assert [answer for answer in answers if answer["findings"]] == []
    old, new = {"2": "old", "4": "old"}, {"2": "new", "4": "new"}
    labels = [answer["labels"] for answer in killed]
    switch = labels.index(new) if new in labels else len(labels)
    assert labels == [old] * switch + [new] * (len(labels) - switch)
    assert old in labels
    assert answers[-1] == {"killed": False, "findings": [], "left": 0, "labels": new}


@pytest.mark.parametrize("data", [b"", b"{}", b"[1]", b'{"format": "terraport-labels"}', b"\xff"])
def test_damaged_labels_are_named_and_take_nothing_away(scene: Path, data: bytes) -> None:
    (scene / "labels.json").write_bytes(data)
    with pytest.raises(DamagedSceneError, match=r"labels\.json: "):
        read_labels(scene)
    assert [finding.code for finding in validate_scene(scene)] == ["labels"]
    with pytest.raises(DamagedSceneError, match=r"labels\.json: "):
        change_labels(scene, {4: "x"})
    assert (scene / "labels.json").read_bytes() == data


def test_damaged_regions_are_named(scene: Path) -> None:
    path = next(scene.glob("v-*/regions.json"))
    path.write_bytes(path.read_bytes().replace(b"bench", b"bunch"))
    with pytest.raises(DamagedSceneError, match=r"regions\.json: hash .* by scene\.json"):
        read_names(scene)
    path.unlink()
    with pytest.raises(DamagedSceneError, match=r"no such file, expected by scene\.json"):
        read_names(scene)


def test_a_label_beyond_the_numbers_is_a_finding(scene: Path) -> None:
    (scene / "labels.json").write_text(
        '{"format": "terraport-labels", "format_version": "1.0",'
        ' "labels": [{"stable_id": 10, "label": "x"}]}'
    )
    assert [str(finding) for finding in validate_scene(scene)] == [
        "error labels: labels.json: a label for stable id 10, expected below 10"
    ]
