"""Whole scenes in object storage: opened, validated, looked for; on moto, and without a network."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from s3_servers import s3_environment
from store.tiny_scene import TinyScene, write_tiny_scene

from terraport_store import (
    DamagedSceneError,
    OriginError,
    Scene,
    SceneNotFoundError,
    change_labels,
    read_labels,
    read_manifest,
    validate_scene,
)
from terraport_store.layout import BASE
from terraport_store.object_files import ObjectStorage
from terraport_store.origin import ObjectOptions, Origin
from terraport_store.upload import upload_scene


@pytest.fixture
def s3(moto: str) -> Iterator[str]:
    with s3_environment(moto):
        yield moto


@pytest.fixture
def url(s3: str, tmp_path: Path) -> str:
    return f"s3://scenes/{tmp_path.name}/tiny"


def test_a_scene_reads_as_from_its_folder(url: str, tiny: TinyScene) -> None:
    upload_scene(tiny.path, url)
    with Scene.open(url) as scene:
        assert scene.manifest == tiny.manifest == read_manifest(url)
        assert scene.regions["regions"][1] == {"id": 1, "label": "bench"}
        assert len(scene.file_mesh(BASE).faces) == 32
        assert [bytes(scene.payload(n)) for n in range(4)] == tiny.payloads
        assert scene.within((0.1, 1.0, -0.1), 0.3).tolist() == [0]
        folder = scene.path
    assert not folder.exists()


def test_a_scene_in_a_folder_of_files(tiny: TinyScene) -> None:
    """file:// is read by the same code, without a network."""
    with Scene.open(f"file://{tiny.path}") as scene:
        assert [bytes(scene.payload(n)) for n in range(4)] == tiny.payloads


def test_validate_finds_nothing_or_names_it(url: str, tiny: TinyScene) -> None:
    upload_scene(tiny.path, url)
    assert validate_scene(url) == []
    pack = tiny.manifest.files["segments.pack"].path
    data = bytearray((tiny.path / pack).read_bytes())
    data[200] ^= 1
    Origin(url, ObjectOptions()).put(pack, bytes(data))
    codes = {finding.code for finding in validate_scene(url)}
    assert "file-hash" in codes


@pytest.mark.parametrize(
    "key", ["base.tsg", "base.cover", "regions.json", "segments.idx", "segments.pack"]
)
def test_a_missing_or_changed_file_is_named(url: str, tiny: TinyScene, key: str) -> None:
    upload_scene(tiny.path, url)
    origin = Origin(url, ObjectOptions(timeout_s=2.0))
    path = tiny.manifest.files[key].path
    origin.put(path, b"something else")
    with pytest.raises(DamagedSceneError, match="expect") as caught:
        Scene.open(url)
    assert caught.value.file == path
    origin.delete([path])
    with pytest.raises(DamagedSceneError, match=r"no such file, expected by scene\.json"):
        Scene.open(url)


def test_no_scene_no_bucket_no_address(url: str) -> None:
    with pytest.raises(SceneNotFoundError, match="s3://scenes/"):
        Scene.open(url)
    with pytest.raises((SceneNotFoundError, OriginError), match="no-such-bucket"):
        Scene.open("s3://no-such-bucket/x")
    with pytest.raises(OriginError, match="expected an address like"):
        Scene.open("s3:///x")


def test_nobody_listens() -> None:
    with (
        s3_environment("http://127.0.0.1:1"),
        ObjectStorage(ObjectOptions(timeout_s=0.5)) as storage,
        pytest.raises(OriginError, match="tries in"),
    ):
        storage.files("s3://a/b").read("scene.json", 10)


def test_folders_of_a_place(s3: str, tiny: TinyScene, tmp_path: Path) -> None:
    prefix = f"s3://scenes/{tmp_path.name}"
    for name in ("b", "a", ".hidden"):
        upload_scene(tiny.path, f"{prefix}/{name}")
    with ObjectStorage() as storage:
        assert storage.folders(prefix) == {"a": f"{prefix}/a", "b": f"{prefix}/b"}
        assert list(storage.folders(f"{prefix}/")) == ["a", "b"]
        assert storage.folders(f"{prefix}/a") == {"a": f"{prefix}/a"}
        assert storage.folders(f"{prefix}/nothing") == {}


def test_stamps_change_with_what_they_stand_for(url: str, tmp_path: Path) -> None:
    write_tiny_scene(tmp_path / "t", stable_ids=(4, 2, 9))
    upload_scene(tmp_path / "t", url)
    with ObjectStorage() as storage:
        files = storage.files(url)
        before, labels = files.stamp("scene.json"), files.stamp("labels.json")
        assert labels is None
        assert read_labels(files) == {}
        upload_scene(tmp_path / "t", url)
        assert files.stamp("scene.json") == before
        change_labels(tmp_path / "t", {2: "bench"})
        upload_scene(tmp_path / "t", url)
        assert files.stamp("labels.json") is not None
        assert read_labels(files) == {2: "bench"}
        write_tiny_scene(tmp_path / "t", seed=1)
        upload_scene(tmp_path / "t", url)
        assert files.stamp("scene.json") != before


def test_versions_share_a_cache_and_scenes_do_not(
    url: str, tiny: TinyScene, tmp_path: Path
) -> None:
    upload_scene(tiny.path, url)
    upload_scene(tiny.path, url + "-2")
    with ObjectStorage(ObjectOptions(cache_dir=tmp_path / "cache")) as storage:
        for scene_url, fetched in ((url, 4), (url, 4), (url + "-2", 8)):
            with Scene.open(storage.files(scene_url)) as scene:
                assert [bytes(scene.payload(n)) for n in range(4)] == tiny.payloads
            assert storage.counts.payloads_fetched == fetched


def test_copies_of_dead_processes_are_swept(tmp_path: Path) -> None:
    script = (
        "import os, sys; from pathlib import Path\n"
        "from terraport_store.object_files import ObjectStorage\n"
        "from terraport_store.origin import ObjectOptions\n"
        "storage = ObjectStorage(ObjectOptions(cache_dir=Path(sys.argv[1])))\n"
        "(storage.new_copy().path / 'base.tsg').write_bytes(b'x')\n"
        "os._exit(0)\n"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=True, timeout=60)
    assert len(list((tmp_path / "open").iterdir())) == 1
    with ObjectStorage(ObjectOptions(cache_dir=tmp_path)) as storage:
        assert list((tmp_path / "open").iterdir()) == []
        copy = storage.new_copy()
        with ObjectStorage(ObjectOptions(cache_dir=tmp_path)):
            assert copy.path.is_dir()  # in use
        copy.close()
        assert not copy.path.exists()


def test_without_the_package_it_is_said(tiny: TinyScene, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("object_files", "origin", "remote_source"):
        monkeypatch.delitem(sys.modules, f"terraport_store.{name}")
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(OriginError, match=r"pip install 'terraport\[s3\]'"):
        Scene.open(f"file://{tiny.path}")
