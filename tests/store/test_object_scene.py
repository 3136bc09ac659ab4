"""Scenes in object storage, moved and removed: whole at one address or the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from s3_servers import Fault, FaultProxy, ProxiedRequest, s3_environment
from store.tiny_scene import TinyScene, write_tiny_scene

from terraport_store import (
    OriginError,
    PublishError,
    Scene,
    SceneNotFoundError,
    change_labels,
    read_labels,
    validate_scene,
)
from terraport_store.object_scene import move_objects, remove_objects, scene_objects
from terraport_store.origin import ObjectOptions, Origin
from terraport_store.upload import upload_scene


@pytest.fixture
def proxy(moto: str) -> Iterator[FaultProxy]:
    with FaultProxy(moto) as between, s3_environment(between.url):
        yield between


@pytest.fixture
def folder(tmp_path: Path) -> str:
    return f"s3://scenes/{tmp_path.name}"


@pytest.fixture
def scene(tmp_path: Path, proxy: FaultProxy, folder: str) -> TinyScene:
    """Two versions at FOLDER/pit, with labels."""
    write_tiny_scene(tmp_path / "pit", seed=1, stable_ids=(4, 2, 9))
    upload_scene(tmp_path / "pit", f"{folder}/pit")
    scene = write_tiny_scene(tmp_path / "pit", stable_ids=(4, 2, 9))
    change_labels(scene.path, {2: "bench"})
    upload_scene(scene.path, f"{folder}/pit")
    return scene


def test_a_move_copies_within_the_storage_and_ends_with_the_manifest(
    proxy: FaultProxy, folder: str, scene: TinyScene
) -> None:
    proxy.requests.clear()
    done: list[int] = []
    moved = move_objects(f"{folder}/pit", f"{folder}/old/pit", progress=done.append)
    assert (moved.copied, moved.kept) == (12, 0)
    assert sum(done) == moved.bytes
    assert not proxy.of("segments.pack")  # no payload came here
    written = [one for one in proxy.requests if one.method in {"PUT", "POST", "DELETE"}]
    assert [one.path.rpartition("/")[2] for one in written][11] == "scene.json"
    assert validate_scene(f"{folder}/old/pit") == []
    assert read_labels(f"{folder}/old/pit") == {2: "bench"}
    with pytest.raises(SceneNotFoundError):
        Scene.open(f"{folder}/pit")
    assert Origin(folder, ObjectOptions()).objects("pit") == []


@pytest.mark.parametrize("cut_at", ["segments.pack", "scene.json", "delete"])
def test_an_interrupted_move_goes_on(
    proxy: FaultProxy, folder: str, scene: TinyScene, cut_at: str
) -> None:
    """Cut at a copy, at the last copy, and between the manifest's deletion and the rest."""
    deleted: list[str] = []

    def rule(request: ProxiedRequest) -> Fault | None:
        if request.method == "PUT" and request.path.endswith(cut_at):
            return Fault(status=403)
        if request.method == "POST" and cut_at == "delete":
            deleted.append(request.path)
            return Fault(status=403) if len(deleted) > 1 else None
        return None

    proxy.rule = rule
    with pytest.raises(OriginError):
        move_objects(f"{folder}/pit", f"{folder}/moved")
    proxy.rule = lambda _: None
    whole = f"{folder}/{'moved' if cut_at == 'delete' else 'pit'}"
    assert validate_scene(whole) == []
    moved = move_objects(f"{folder}/pit", f"{folder}/moved")
    assert moved.kept > 0
    assert validate_scene(f"{folder}/moved") == []
    assert Origin(folder, ObjectOptions()).objects("pit") == []


def test_another_scene_is_never_overwritten(folder: str, scene: TinyScene, tmp_path: Path) -> None:
    other = write_tiny_scene(tmp_path / "other", seed=5)
    upload_scene(other.path, f"{folder}/other")
    with pytest.raises(PublishError, match=r"a scene is at .*/other, expected none"):
        move_objects(f"{folder}/pit", f"{folder}/other")
    assert validate_scene(f"{folder}/pit") == []
    with pytest.raises(SceneNotFoundError):
        move_objects(f"{folder}/nothing", f"{folder}/other")


def test_to_another_bucket_the_bytes_come_through_here(folder: str, scene: TinyScene) -> None:
    """Whole, and in parts: the report is larger than one."""
    (scene.path / "report.html").write_bytes(bytes(9 << 20))
    upload_scene(scene.path, f"{folder}/pit")
    target = folder.replace("s3://scenes", "s3://packs")
    assert move_objects(f"{folder}/pit", target).copied == 13
    assert Origin(target, ObjectOptions()).get("report.html", 10 << 20) == bytes(9 << 20)
    assert validate_scene(target) == []
    # Its uploads resume there: the hashes went along.
    assert upload_scene(scene.path, target).kept_files == 5


def test_a_removal_leaves_what_is_none_of_the_scene(folder: str, scene: TinyScene) -> None:
    origin = Origin(f"{folder}/pit", ObjectOptions())
    origin.put("notes.txt", b"mine")
    objects = scene_objects(f"{folder}/pit")
    assert objects[-1].path == "scene.json"
    count, size = remove_objects(f"{folder}/pit")
    assert (count, size) == (12, sum(one.size for one in objects))
    assert [one.path for one in origin.objects()] == ["notes.txt"]
    with pytest.raises(SceneNotFoundError, match=r"expected scene\.json there"):
        remove_objects(f"{folder}/pit")
